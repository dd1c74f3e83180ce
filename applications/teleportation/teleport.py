"""Teleportation: states of the opener appear at the acceptor, by pairs and two bits for each.

Arriving states are checked: the opener discloses which states it sent, and the acceptor measures
whether it holds them: the share of those that it finds is the fidelity. Random states are the six
cardinal ones, whose mean fidelity is that of all states; on the backend dense they may be any. The
acceptor cannot correct before the bits are there: they are what it corrects by. protocol.py
decides; here it is carried out.
"""

from dataclasses import dataclass

from applications.teleportation import protocol, qubit_states
from applications.teleportation.qubit_states import RANDOM
from hosts.middleware.session.ends import AcceptorEnd, OpenerEnd, ServiceKind
from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.options import MAX_COUNT, ServiceOptions
from wire.metadata.vocabulary import Service
from wire.parameters.option import option


@dataclass(frozen=True)
class TeleportOptions(ServiceOptions):
    """`count` states, each the same or at random: a name or angles, as qubit_states has them."""

    state: str = option(
        RANDOM,
        f"each of them: {', '.join(qubit_states.NAMES)} or random (of these six); on --backend "
        "dense also haar (random on the Bloch sphere) or angles in rad, as 1.2,0.5 or pi/3,-pi/4 "
        "(random)",
        metavar="NAME|THETA,PHI",
    )
    count: int = option(10_000, "states (10000)", metavar="N", range=(1, MAX_COUNT))

    def check(self) -> None:
        super().check()
        qubit_states.check(self.state)

    def check_backend(self, backend: str) -> None:
        if backend != "dense" and qubit_states.needs_vectors(self.state):
            text = f"--state {self.state} is not a stabiliser state, as --backend {backend} holds "
            names = ", ".join(qubit_states.NAMES)
            text += f"them: add --backend dense, or choose {names} or random"
            raise unsupported(text)


async def teleport(end: OpenerEnd, options: TeleportOptions) -> None:
    await end.perform(protocol.send(end.side, options.state, options.count))


async def receive(end: AcceptorEnd) -> None:
    await end.perform(protocol.receive(end.side))


KIND = ServiceKind(Service["TELEPORT"], TeleportOptions, teleport, receive)
