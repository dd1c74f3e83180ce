"""Checks of what a request asks for, before anything is changed."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import MAX_BLOCKS, Block
from dispatcher.operations import emission
from dispatcher.refusal import Refusal, exhausted, invalid
from dispatcher.sabot.backend import Angle, Bytes
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.gates import ROTATIONS
from dispatcher.sabot.limits import packed
from dispatcher.switch.optical_switch import MAX_POWER_DBM, Channel
from dispatcher.timeouts import MAX_TIMEOUT_S
from wire import dibits
from wire.dispatcher_pb2 import (
    ApplyRequest,
    Connection,
    CreateRequest,
    Gate,
    MeasureRequest,
    Order,
    TunePortRequest,
)
from wire.keyed import KEY_BYTES, KeyedChoices
from wire.outcomes import BASES
from wire.parameters.physics import SUM_TOLERANCE
from wire.parameters.switch import TEMPERATURE_C, QuantumSwitch

MAX_ANGLE_RAD = 1e6
MAX_STEPS = 64
MAX_PICKS = 4096
MAX_TIMES = 64  # of an order that is repeated
REPEATED = ("receive", "bell_measure")
MAX_ORDERS = 256  # of one call, at a time
# Shorter than what a switch's timeline remembers.
MAX_EMISSION_S = 30.0


def states(request: CreateRequest) -> Bytes | None:
    states = request.states or request.state_dibits
    if request.state != CreateRequest.PREPARED:
        if states:
            name = CreateRequest.State.Name(request.state)
            raise invalid(f"{len(states)} states for a block of {name}; only PREPARED has any")
        return None
    if not request.state_dibits:
        return packed("states", request.states, request.count, len(emission.STATES) - 1)
    if request.states:
        raise invalid("a request with states and state_dibits; leave one of them out")
    try:
        return dibits.unpack(request.state_dibits, request.count, "little")
    except ValueError as error:
        raise invalid(f"state_dibits: {error}; send two bits for each, and fill up by 0") from error


def choices(request: CreateRequest, intensities: int) -> KeyedChoices | None:
    """Return what a key chooses for each photon; None without one."""
    if not request.HasField("key"):
        return None
    if request.state != CreateRequest.PREPARED or request.states or request.state_dibits:
        raise invalid("a request with a key and states; send PREPARED with one of them")
    if request.levels:
        raise invalid("a request with a key and levels; leave one of them out")
    shares = tuple(request.key.shares)
    if shares and (len(shares) != intensities or not _is_distribution(shares)):
        raise invalid(f"shares {shares} of a source with {intensities} intensities; send one each")
    if not request.count:
        raise invalid("count is 0; name the photons to be made")
    return KeyedChoices(_key(request.key.key), request.count, shares)


def _is_distribution(shares: tuple[float, ...]) -> bool:
    return all(0 <= share <= 1 for share in shares) and abs(sum(shares) - 1) < SUM_TOLERANCE


def _key(key: bytes) -> bytes:
    if len(key) != KEY_BYTES:
        raise invalid(f"a key of {len(key)} bytes; send {KEY_BYTES}")
    return key


def levels(request: CreateRequest, intensities: int) -> Bytes | None:
    """Return the number of each pulse's intensity, None if all have the first.

    Refuse those of a block that is not prepared, and what the source cannot make.
    """
    if not request.levels:
        return None
    if request.state != CreateRequest.PREPARED:
        name = CreateRequest.State.Name(request.state)
        raise invalid(f"{len(request.levels)} levels for a block of {name}; only PREPARED has any")
    return packed("levels", request.levels, request.count, intensities - 1)


def paulis(request: ApplyRequest, photons: int) -> Bytes | None:
    """Return the Pauli of each photon, however they are packed; None if there are none."""
    if not request.dibits:
        return packed("paulis", request.paulis, photons, 3) if request.paulis else None
    if request.paulis:
        raise invalid("a request with paulis and dibits; leave one of them out")
    try:
        return dibits.unpack(request.dibits, photons, "little")
    except ValueError as error:
        raise _wrong_dibits(error) from error


def packed_paulis(request: ApplyRequest, photons: int) -> bytes:
    """Return the Pauli of each photon in two bits, the first lowest; empty if there are none."""
    if request.paulis:
        values = paulis(request, photons)
        assert values is not None
        return dibits.pack(values, "little")
    given = request.dibits  # each look at a field copies it
    try:
        if given:
            dibits.require(given, photons, "little")
    except ValueError as error:
        raise _wrong_dibits(error) from error
    return given


def _wrong_dibits(error: ValueError) -> Refusal:
    return invalid(f"dibits: {error}; send two for each photon, and fill up by 0")


def bases(request: MeasureRequest, photons: int) -> Callable[[NDArray[np.int64]], Bytes]:
    """Return what tells the bases of some photons, by their positions."""
    if not request.key:
        return _bases(request, photons).__getitem__
    if request.bases or request.basis_bits:
        raise invalid("a request with a key and bases; leave one of them out")
    return KeyedChoices(_key(request.key), photons).bases


def _bases(request: MeasureRequest, photons: int) -> Bytes:
    """Return the basis of each photon, however they are packed."""
    if request.basis not in MeasureRequest.Basis.values():
        raise invalid(f"basis {request.basis} is unknown; use {', '.join(BASES)}")
    if request.bases and request.basis_bits:
        raise invalid("a request with bases and basis_bits; leave one of them out")
    if request.bases:
        return packed("bases", request.bases, photons, len(BASES) - 1)
    if not request.basis_bits:
        return np.full(photons, request.basis, np.uint8)
    if len(request.basis_bits) != (photons + 7) // 8:
        raise invalid(
            f"basis_bits has {len(request.basis_bits)} bytes for {photons} photons; send one for "
            "each eight"
        )
    bits = np.unpackbits(np.frombuffer(request.basis_bits, np.uint8))
    if bits[photons:].any():
        raise invalid(f"basis_bits has bits set behind the last of {photons} photons; fill up by 0")
    return bits[:photons]


def angle(name: str, gate: Gate, photons: int, backend: str) -> Angle:
    """Return a gate's angle, or that of each photon; 0 of a gate that has none.

    Refuse one that is not a number or too large to mean one, and angles that do not fit the block
    or the backend.
    """
    if not gate.angles_rad:
        _require_angle(name, gate.angle_rad)
        return gate.angle_rad
    if gate.angle_rad:
        raise invalid(f"gate {name} has angle_rad and angles_rad; leave one of them out")
    if name not in ROTATIONS:
        raise invalid(f"angles_rad for gate {name}, which takes none; leave them out")
    if len(gate.angles_rad) != photons:
        raise invalid(f"angles_rad has {len(gate.angles_rad)} for {photons} photons; send one each")
    angles = np.array(gate.angles_rad)
    _require_angle(name, float(angles[np.abs(angles).argmax()]))
    if backend != Dense.NAME:
        raise invalid(
            f"gate {name} has an angle for each of {photons} photons, and this network simulates "
            f"with backend {backend}; start it with --backend dense, or give one angle_rad for all"
        )
    return angles


def _require_angle(gate: str, angle_rad: float) -> None:
    if gate not in ROTATIONS and angle_rad:
        raise invalid(f"angle_rad {angle_rad:g} for gate {gate}, which takes none; leave it out")
    if not abs(angle_rad) <= MAX_ANGLE_RAD:
        raise invalid(
            f"angle_rad {angle_rad:g} of gate {gate} is not between -{MAX_ANGLE_RAD:g} and "
            f"{MAX_ANGLE_RAD:g}; an angle repeats after 4 pi"
        )


def require_steps(count: int) -> None:
    if not 1 <= count <= MAX_STEPS:
        raise invalid(f"{count} steps; send 1 to {MAX_STEPS} in an order")


def require_times(order: Order) -> None:
    """Refuse to repeat an order too often, or one that does not only receive and measure pairs."""
    if order.times > MAX_TIMES:
        raise invalid(f"{order.times} times; send at most {MAX_TIMES} in an order")
    for step in order.steps if order.times > 1 else ():
        if step.WhichOneof("operation") not in REPEATED:
            raise invalid(f"a step that cannot be repeated; repeat {' and '.join(REPEATED)} alone")


def require_outcomes(layer: PhysicalLayer, block: Block) -> None:
    """Refuse a block of weak pulses for which a reply with a place for each would be too long."""
    if block.weak is not None and block.size > layer.max_live_qubits:
        raise exhausted(
            f"{block.size} outcomes of {block.name} are more than {layer.max_live_qubits}; "
            "make smaller blocks, or measure by a key"
        )


def require_picks(count: int) -> None:
    if not 1 <= count <= MAX_PICKS:
        raise invalid(f"{count} picks; name 1 to {MAX_PICKS} blocks")


def require_blocks(layer: PhysicalLayer, more: int, *makers: str) -> None:
    if layer.ownership.count + more > MAX_BLOCKS:
        raise exhausted(f"{MAX_BLOCKS} blocks are live; use larger blocks or discard some")
    for maker in makers:
        if layer.ownership.makers.blocks_of(maker) + more > layer.share_of_blocks:
            raise exhausted(
                f"{layer.share_of_blocks} blocks that {maker} has made are live, its share; use "
                "larger blocks or discard some"
            )


def require_rate(rate_hz: int, longest: int) -> None:
    """Refuse a rate at which the longest block of a launch would take too long."""
    if rate_hz == 0:
        raise invalid("rate_hz is 0; name the source's pulses per second")
    if longest / rate_hz > MAX_EMISSION_S:
        raise invalid(
            f"{longest} photons at rate_hz {rate_hz} take {longest / rate_hz:.0f} s, more than "
            f"{MAX_EMISSION_S:.0f} s; send smaller blocks or raise the rate"
        )


def require_source_rate(block: Block, rate_hz: int) -> None:
    if rate_hz > block.source_rate_hz:
        raise invalid(
            f"rate_hz {rate_hz} is more than the source of {block.name} can emit, max_rate_hz "
            f"{block.source_rate_hz:g}; lower the rate"
        )


def timeout(timeout_s: float, most_s: float = MAX_TIMEOUT_S) -> float:
    if not timeout_s > 0:
        raise invalid(f"timeout_s {timeout_s} is not positive; say how long to wait")
    return min(timeout_s, most_s)


def cross_connects(connections: Iterable[Connection]) -> dict[int, int]:
    """Return in_port to out_port; light of two inputs cannot leave by one output."""
    outputs: dict[int, int] = {}
    inputs: dict[int, int] = {}
    for connection in connections:
        in_port, out_port = connection.in_port, connection.out_port
        if in_port in outputs:
            raise invalid(f"input port {in_port} is named twice; connect it to one output")
        if out_port in inputs:
            raise invalid(
                f"inputs {inputs[out_port]} and {in_port} share output port {out_port}; "
                "close one of the paths first"
            )
        outputs[in_port] = out_port
        inputs[out_port] = in_port
    return outputs


def require_direction(direction: int) -> None:
    if direction not in TunePortRequest.Direction.values():
        raise invalid(f"direction {direction} is not known; choose 0 (both), 1 or 2")


def require_tuning(
    switch: QuantumSwitch,
    frequency_mhz: int,
    power_dbm: float | None,
    channel: Channel | None = None,
) -> None:
    """Refuse what a switch's port cannot be tuned to; frequency 0 and power None ask nothing.

    The port of a channel has that one's frequency.
    """
    least, most, grid = switch.min_frequency_mhz, switch.max_frequency_mhz, switch.grid_mhz
    if channel is not None:
        least, most = channel.frequency_mhz, channel.frequency_mhz
    if frequency_mhz and not least <= frequency_mhz <= most:
        raise invalid(f"frequency_mhz {frequency_mhz} is not between {least} and {most}")
    if frequency_mhz and (frequency_mhz - least) % grid:
        below = frequency_mhz - (frequency_mhz - least) % grid
        raise invalid(
            f"frequency_mhz {frequency_mhz} is between channels of the grid of {grid} MHz; "
            f"tune to {below}" + (f" or {below + grid}" if below + grid <= most else "")
        )
    if power_dbm is not None and not switch.min_power_dbm <= power_dbm <= MAX_POWER_DBM:
        raise invalid(
            f"power_dbm {power_dbm:g} is not between {switch.min_power_dbm:g} and {MAX_POWER_DBM:g}"
        )


def require_temperature(temperature_c: float) -> None:
    least, most = TEMPERATURE_C
    if not least <= temperature_c <= most:
        raise invalid(f"temperature_c {temperature_c:g} is not between {least:g} and {most:g}")
