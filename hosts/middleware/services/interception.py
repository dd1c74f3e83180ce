"""Intercept and resend: what a host does to the light of others that goes by way of it.

    alice ---> first fibre | this host | second fibre ---> bob
                 a fraction is measured in Z or X, at random, and sent on as it was found

Nothing is said to anybody: whoever is asked for this needs no session, only light that comes.
"""

from collections.abc import Awaitable, Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hosts.hardware.qnic import LEFT_ALONE, BlockName, NoLight, Qnic, Received, Symbols
from hosts.middleware.session.channel import SessionError
from hosts.middleware.session.options import Options, check_whole
from hosts.timeouts import RESENT_TIMEOUT_S
from wire.metadata import Reason, Setup
from wire.optical import WAVELENGTHS_PM
from wire.outcomes import NO_COINCIDENCE

FIBERS = 2
MAX_RATE_HZ = 4_000_000_000
BASES = ("Z", "X")


@dataclass(frozen=True)
class InterceptionOptions(Options):
    """What an application chooses."""

    fraction: float = 1.0  # of the photons; the others are only sent on
    wavelength_pm: int = Setup.wavelength_pm  # at which light is sent on

    def check(self) -> None:
        """Raise SessionError for a value out of range."""
        fraction = self.fraction
        number = isinstance(fraction, (int, float)) and not isinstance(fraction, bool)
        if not number or not 0 <= fraction <= 1:
            raise SessionError(Reason.UNSUPPORTED, f"fraction is {fraction!r}: choose 0 to 1")
        check_whole("wavelength_pm", self.wavelength_pm, *WAVELENGTHS_PM)


@dataclass
class Seen:
    """What was seen so far."""

    blocks: int = 0  # that were sent on
    photons: int = 0  # places for photons in them
    measured: int = 0  # places that were looked at
    zeros: int = 0
    ones: int = 0
    lost_blocks: int = 0  # whose light was gone before it could be received


Tell = Callable[..., Awaitable[None]]


class Interception:
    """Receives, measures and resends whatever arrives at the first fibre."""

    def __init__(self, qnic: Qnic, options: InterceptionOptions, seed: int, host: str) -> None:
        """Raise SessionError if this host has too few fibres."""
        if len(qnic.ports) < FIBERS:
            text = f"interception needs {FIBERS} fibres, this host has {len(qnic.ports)}"
            raise SessionError(Reason.UNSUPPORTED, text)
        self._qnic, self._options, self._seed, self._host = qnic, options, seed, host
        self._arrivals = qnic.arrivals(qnic.ports[0])  # from now on
        self._seen = Seen()

    @property
    def summary(self) -> dict[str, Any]:
        """Return what the application is told in the end."""
        return {"fraction": self._options.fraction, **asdict(self._seen)}

    async def run(self, tell: Tell) -> None:
        """Go on until cancelled; tell of each block. Raise HardwareError if it cannot go on."""
        async for block in self._arrivals:
            try:
                outcomes = await self._pass_on(block)
            except NoLight:
                self._seen.lost_blocks += 1
                continue
            except BaseException:
                await self._qnic.discard_block(block.session, block.number)
                raise
            await tell(**self._note(block, outcomes))

    async def _pass_on(self, block: BlockName) -> Symbols:
        """Return what was found of each photon."""
        inward, outward = self._qnic.ports[:FIBERS]
        received = await self._qnic.receive(block, inward, RESENT_TIMEOUT_S)
        bases = self._choose(block, received.photons)
        outcomes = np.full(bases.size, NO_COINCIDENCE, dtype=np.uint8)
        if (bases != LEFT_ALONE).any():
            outcomes = await self._qnic.resend(block, bases)
        self._seen.measured += int(np.count_nonzero(bases != LEFT_ALONE))
        wavelength_pm = self._options.wavelength_pm
        await self._qnic.send(block, outward, rate_of(received), wavelength_pm)
        return outcomes

    def _choose(self, block: BlockName, photons: int) -> Symbols:
        """Return a basis for each photon; the same block, the same choices, whenever it comes."""
        words = self._seed, block.session, block.number, block.half, *self._host.encode()
        random = np.random.default_rng(words)
        chosen = random.random(photons) < self._options.fraction
        bases = random.integers(0, len(BASES), photons, dtype=np.uint8)
        return np.where(chosen, bases, LEFT_ALONE).astype(np.uint8)

    def _note(self, block: BlockName, outcomes: Symbols) -> dict[str, Any]:
        zeros, ones = (int(np.count_nonzero(outcomes == bit)) for bit in (0, 1))
        self._seen.blocks += 1
        self._seen.photons += outcomes.size
        self._seen.zeros += zeros
        self._seen.ones += ones
        name = {"session": f"{block.session:016x}", "block": block.number, "half": block.half}
        return {**name, "photons": outcomes.size, "zeros": zeros, "ones": ones}


def rate_of(received: Received) -> int:
    """Return at which rate (Hz) photons came: what is sent on must not take longer."""
    span_ns = received.last_ns - received.first_ns
    if span_ns <= 0:
        return MAX_RATE_HZ
    return max(1, min(round((received.photons - 1) * 1e9 / span_ns), MAX_RATE_HZ))
