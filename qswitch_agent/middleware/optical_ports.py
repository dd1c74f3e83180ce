"""The optics of ports and paths as OpenFlow describes, tunes and measures them."""

from dataclasses import replace
from math import isfinite
from typing import NamedTuple

from qswitch_agent.hardware.optics import (
    Condition,
    Direction,
    Path,
    PortReading,
    Quantity,
    Readings,
    Tuning,
)
from qswitch_agent.openflow import refusals
from wire import optical
from wire.optical import PathOptics, PortLight, PortOptics, PortTuning

MAX_LOSS_MDB = 0xFFFFFFFF  # a path that passes no light at all
DIRECTIONS = {
    optical.RX_TUNE: Direction.RECEIVE,
    optical.TX_TUNE: Direction.TRANSMIT,
    optical.RX_TUNE | optical.TX_TUNE: Direction.BOTH,
}
VALID = {  # what the flags of statistics say of each quantity that a switch may not measure
    Quantity.FREQUENCY: optical.VALID_RX_TUNE | optical.VALID_TX_TUNE,
    Quantity.TX_POWER: optical.VALID_TX_PWR,
    Quantity.RX_POWER: optical.VALID_RX_PWR,
    Quantity.BIAS: optical.VALID_TX_BIAS,
    Quantity.TEMPERATURE: optical.VALID_TX_TEMP,
}


class Tuned(NamedTuple):
    """The tuning that a PORT_MOD requests; None: no change."""

    frequency_mhz: int | None
    power_dbm: float | None
    direction: Direction = Direction.BOTH
    cutoff_s: float | None = None  # of a memory
    down: bool | None = (
        None  # a port inside the switch, which Open vSwitch sets neither up nor down
    )


def description(condition: Condition, port: int) -> PortOptics:
    """Return how far a port can be tuned, as its description tells.

    The port of a channel has one frequency, and no bit says that it could be tuned.
    """
    tuning = tuning_of(condition, port)
    if tuning is None:
        return PortOptics(0, 0, 0, 0, 0, 0, 0, 0, 0)
    least, most, grid = tuning.min_mhz, tuning.max_mhz, tuning.grid_mhz
    low_dbm, high_dbm = round(tuning.min_dbm * 10), round(tuning.max_dbm * 10)
    fixed = optical.TX_PWR | optical.USE_FREQ
    supported = fixed if port in condition.channels else optical.TUNABLE
    return PortOptics(supported, least, most, grid, least, most, grid, low_dbm, high_dbm)


def tuning_of(condition: Condition, port: int) -> Tuning | None:
    channel, tuning = condition.channels.get(port), condition.tuning
    if channel is None or tuning is None:
        return tuning
    return replace(tuning, min_mhz=channel.mhz, max_mhz=channel.mhz, grid_mhz=channel.grid_mhz)


def tuned(requested: PortTuning, tuning: Tuning | None) -> Tuned:
    """Return what a PORT_MOD asks for; raise Refusal for what ports cannot be tuned to."""
    if unknown := requested.configure & ~optical.TUNABLE:
        raise refusals.bad_value(f"configure has the bits {unknown:#x}, which mean nothing")
    power_dbm = requested.tx_power / 10 if requested.configure & optical.TX_PWR else None
    frequency_mhz, direction = None, Direction.BOTH
    if ends := requested.configure & (optical.TX_TUNE | optical.RX_TUNE):
        if not requested.configure & optical.USE_FREQ:
            raise refusals.bad_value("give a frequency in MHz, with OFPOPF_USE_FREQ")
        frequency_mhz, direction = requested.frequency + requested.offset, DIRECTIONS[ends]
    if tuning is None:
        raise refusals.bad_value("the ports of this switch cannot be tuned")
    if frequency_mhz is not None and not _on_grid(frequency_mhz, tuning):
        raise refusals.bad_value(
            f"{frequency_mhz} MHz: ports are tuned to {tuning.min_mhz} to {tuning.max_mhz} "
            f"MHz in steps of {tuning.grid_mhz} MHz"
        )
    if power_dbm is not None and not tuning.min_dbm <= power_dbm <= tuning.max_dbm:
        limits = f"{tuning.min_dbm} to {tuning.max_dbm} dBm"
        raise refusals.bad_value(f"{power_dbm} dBm: the power is {limits}")
    return Tuned(frequency_mhz, power_dbm, direction)


def light(readings: Readings, port: int, whole: bool, grid_mhz: int) -> PortLight:
    """Return the optical statistics of a port; their flags say which fields are measured.

    A power that its flag makes invalid reads as no light, as of no fibre or a cut one.
    """
    reading = readings.ports.get(port)
    missing = set(readings.not_measured) if reading else set(Quantity)
    reading = reading or PortReading()
    tx_dbm = None if Quantity.TX_POWER in missing else _finite(reading.tx_dbm)
    rx_dbm = None if Quantity.RX_POWER in missing or not whole else _finite(reading.rx_dbm)
    missing |= {Quantity.TX_POWER} if tx_dbm is None else set()
    missing |= {Quantity.RX_POWER} if rx_dbm is None else set()
    return PortLight(
        sum(bits for quantity, bits in VALID.items() if quantity not in missing),
        *(reading.tx_mhz, 0, grid_mhz),
        *(reading.rx_mhz, 0, grid_mhz),
        optical.DARK if tx_dbm is None else _signed(tx_dbm * 10),
        optical.DARK if rx_dbm is None else _signed(rx_dbm * 10),
        round(max(0.0, min(65535.0, reading.bias_ma * 10))),
        _signed(readings.temperature_c * 10),
    )


def path_optics(condition: Condition) -> list[PathOptics]:
    """Return what paths do to light: first all that are not named, then the others."""
    paths = [_path_optics((optical.ANY_PORT, optical.ANY_PORT), condition.others, False)]
    named = {**condition.paths}
    for ports in condition.stuck:
        named.setdefault(ports, condition.others)
    return paths + [
        _path_optics(ports, named[ports], ports in condition.stuck) for ports in sorted(named)
    ]


def _path_optics(ports: tuple[int, int], path: Path, stuck: bool) -> PathOptics:
    loss_mdb = round(min(path.loss_db * 1000, MAX_LOSS_MDB))
    return PathOptics(*ports, loss_mdb, path.rotation, stuck)


def _on_grid(frequency_mhz: int, tuning: Tuning) -> bool:
    within = tuning.min_mhz <= frequency_mhz <= tuning.max_mhz
    step = tuning.grid_mhz or 1
    return within and (frequency_mhz - tuning.min_mhz) % step == 0


def _finite(power_dbm: float | None) -> float | None:
    """Return a power, None if there is no light at all: -infinity dBm, which no field can say."""
    return power_dbm if power_dbm is not None and isfinite(power_dbm) else None


def _signed(value: float) -> int:
    """Return the nearest number that fits 16 bits."""
    return round(max(-32768.0, min(32767.0, value)))
