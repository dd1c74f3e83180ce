"""The protocol of an eavesdropper: blocks that come are attacked and sent on."""

from typing import Any

from hosts.hardware.qnic import BlockName, NoLight, Qnic, Received
from hosts.middleware.services.interception.attacks import (
    Attack,
    InterceptResend,
    PhotonSplitting,
    Way,
)
from hosts.middleware.services.interception.options import (
    RESEND,
    SPLIT,
    InterceptionOptions,
    refused,
)
from hosts.middleware.session.protocol import Steps, do
from hosts.timeouts import RESENT_TIMEOUT_S

FIBERS = 2
MAX_RATE_HZ = 4_000_000_000


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
            raise refused(f"interception needs {FIBERS} fibres, this host has {len(ports)}")
        if options.attack == SPLIT and not memory_qubits:
            raise refused("photons that are split off wait in a memory, and this host has none")
        self.inward, self._outward = ports[:FIBERS]
        self._options = options
        self.attack: Attack = (
            InterceptResend(options.fraction, seeds)
            if options.attack == RESEND
            else PhotonSplitting(Way(options.expected_db, options.onward_db), seeds, memory_qubits)
        )
        self._blocks = self._photons = self._lost_blocks = 0

    @property
    def summary(self) -> dict[str, Any]:
        """Return what the application is told in the end."""
        return {
            "attack": self._options.attack,
            "fraction": self._options.fraction,
            "blocks": self._blocks,  # that were sent on
            "photons": self._photons,  # places for photons in them
            **self.attack.summary,
            "lost_blocks": self._lost_blocks,  # whose light was gone before it could be received
        }

    def pass_on(self, block: BlockName) -> Steps[dict[str, Any] | None]:
        """Return what is told of a block; None: its light was gone."""
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
