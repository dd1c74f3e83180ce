"""Light that is measured as it arrives, in Z or X."""

import numpy as np

from hosts.hardware import steps
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols, bits_of
from hosts.middleware.session.protocol import (
    Collect,
    HostSide,
    Light,
    Side,
    Steps,
    begin,
    require_size,
)
from hosts.timeouts import KEY_GRACE_S, LIGHT_TIMEOUT_S
from wire.outcomes import NO_COINCIDENCE


def random_bases(side: HostSide, photons: int) -> Symbols:
    return side.draws.integers(0, 2, photons, dtype=np.uint8)


def measuring(side: Side, name: BlockName, bases: Symbols) -> Steps[Light]:
    return begin(measure_arrivals, name, side.ports[0], bases, LIGHT_TIMEOUT_S)


async def measure_arrivals(
    qnic: Qnic, block: BlockName, port: str, bases: Symbols, timeout_s: float
) -> Symbols:
    """Measure the photons that arrive at a port, as `measure` does; NoLight if none does."""
    _received, measured = await qnic.perform(
        steps.receive(block, port, timeout_s), steps.measure(block, bases)
    )
    return bits_of(measured)


def measured(side: Side, light: Light, photons: int) -> Steps[Symbols]:
    """Return the outcomes of light that is over; no click for any photon if none has come."""
    outcomes = yield Collect(light, KEY_GRACE_S + photons / side.setup.rate_hz)
    if outcomes is None:
        return np.full(photons, NO_COINCIDENCE, dtype=np.uint8)
    require_size(outcomes.size, photons)
    return outcomes  # type: ignore[no-any-return]


def turned_back(outcomes: Symbols, bases: Symbols, rotation: int) -> Symbols:
    """Return outcomes as they were without a known Pauli operator on the way (bits: X, Z)."""
    if not rotation:
        return outcomes
    flips = rotation >> bases & 1  # X turns outcomes of Z round, Z those of X
    return np.where(outcomes == NO_COINCIDENCE, outcomes, outcomes ^ flips).astype(np.uint8)
