"""The protocol of an eavesdropper: blocks that come are attacked and sent on."""

from dataclasses import dataclass, field
from typing import Any

from applications.interception.attacks import Attack, InterceptResend, PathLosses, PhotonSplitting
from applications.timeouts import RESENT_TIMEOUT_S
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import NoLight, Received
from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.options import MAX_RATE_HZ, Options
from hosts.middleware.session.protocol import Steps, do
from wire.metadata.setup import Setup
from wire.optical import WAVELENGTHS_PM
from wire.results.figures import EveFigures
from wire.socket_calls import ATTACKS, RESEND, SPLIT

FIBERS = 2
MAX_DB = 1_000.0


@dataclass(frozen=True)
class InterceptionOptions(Options):
    # Of the photons; the others are only sent on.
    fraction: float = field(default=1.0, metadata={"range": (0.0, 1)})
    attack: str = field(default=RESEND, metadata={"choices": ATTACKS})
    # Of splitting: what light loses from here to a click, as both ends expect it, and as it is.
    expected_db: float = field(default=0.0, metadata={"range": (0.0, MAX_DB)})
    onward_db: float = field(default=0.0, metadata={"range": (0.0, MAX_DB)})
    # At which light is sent on.
    wavelength_pm: int = field(default=Setup.wavelength_pm, metadata={"range": WAVELENGTHS_PM})

    def check(self) -> None:
        super().check()
        if self.attack == SPLIT and self.fraction != 1:
            raise unsupported(f"fraction is {self.fraction!r}: {SPLIT} is of every pulse, choose 1")
        if self.attack == RESEND and (self.expected_db or self.onward_db):
            raise unsupported(f"expected_db and onward_db are of {SPLIT}: leave them out")
        if self.onward_db > self.expected_db:
            raise unsupported(
                f"onward_db is {self.onward_db!r}, more than expected_db {self.expected_db!r}: "
                "who attacks so has a better way, not a worse one"
            )


class Passing:
    """Light on its way through this host, and what was seen of it."""

    def __init__(
        self,
        ports: list[str],
        options: InterceptionOptions,
        seeds: tuple[int, ...],
        memory_qubits: int,
    ) -> None:
        """Raise SessionError if this host has too few fibres, or lacks a memory."""
        if len(ports) < FIBERS:
            raise unsupported(f"interception needs {FIBERS} fibres, this host has {len(ports)}")
        if options.attack == SPLIT and not memory_qubits:
            raise unsupported("photons that are split off wait in a memory, and this host has none")
        self.inward, self._outward = ports[:FIBERS]
        self._options = options
        self.attack: Attack = (
            InterceptResend(options.fraction, seeds)
            if options.attack == RESEND
            else PhotonSplitting(
                PathLosses(options.expected_db, options.onward_db), seeds, memory_qubits
            )
        )
        self._blocks = self._photons = self._lost_blocks = 0

    @property
    def summary(self) -> EveFigures:
        return EveFigures(
            attack=self._options.attack,
            fraction=self._options.fraction,
            blocks=self._blocks,  # that were sent on
            photons=self._photons,  # places for photons in them
            **self.attack.summary,
            lost_blocks=self._lost_blocks,  # whose light was gone before it could be received
        )

    def pass_on(self, block: BlockName) -> Steps[dict[str, Any] | None]:
        """Return a block's counts; None: its light was gone."""
        try:
            received = yield from do(Qnic.receive, block, self.inward, RESENT_TIMEOUT_S)
            seen = yield from self.attack.attack(block, received.photons)
            wavelength_pm = self._options.wavelength_pm
            yield from do(Qnic.send, block, self._outward, rate_of(received), wavelength_pm)
        except NoLight:
            self._lost_blocks += 1
            return None
        self._blocks += 1
        self._photons += received.photons
        name = {"session": f"{block.session:016x}", "block": block.number, "half": block.half}
        return {**name, "photons": received.photons, **seen}


def rate_of(received: Received) -> int:
    """Return at which rate (Hz) photons came: what is sent on must not take longer."""
    span_ns = received.last_ns - received.first_ns
    if span_ns <= 0:
        return MAX_RATE_HZ
    return max(1, min(round((received.photons - 1) * 1e9 / span_ns), MAX_RATE_HZ))
