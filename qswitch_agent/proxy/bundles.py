"""The bundles that a controller has open, as far as light is concerned.

The bridge holds them, too, and commits them; the agent must know what is in them to judge
it at COMMIT.
"""

from dataclasses import dataclass, field

from qswitch_agent.middleware.optical_ports import Tuned
from qswitch_agent.openflow import constants as ofp
from qswitch_agent.openflow import packets, refusals
from qswitch_agent.openflow.flows import FlowMod

MAX_BUNDLES = 256
MAX_BYTES = 1 << 24

Tunings = list[tuple[int, Tuned]]  # by port


@dataclass
class Member:
    message: bytes  # the message itself, as the controller sent it
    envelope: bytes  # the BUNDLE_ADD_MESSAGE around it
    mod: FlowMod | None = None  # as sent to the bridge
    light: bool = False  # it adds or modifies light entries
    sent: bool = True  # to the bridge; False: it depends on what the table is at COMMIT


@dataclass
class Bundle:
    members: list[Member] = field(default_factory=list)
    tunings: Tunings = field(default_factory=list)

    @property
    def late(self) -> bool:
        """Whether members wait for COMMIT; those behind them must wait, too."""
        return bool(self.members) and not self.members[-1].sent

    @property
    def concerns_light(self) -> bool:
        return any(member.light or not member.sent for member in self.members)

    @property
    def last_light(self) -> Member | None:
        """The member to blame if the paths that the bundle makes do not go together."""
        return next((member for member in reversed(self.members) if member.light), None)


class Bundles:
    def __init__(self) -> None:
        self._open: dict[int, Bundle] = {}
        self._bytes = 0
        self.committing: dict[int, Tunings] = {}  # until the bridge has answered

    def begin(self, number: int) -> None:
        """Note that a bundle is opened; the bridge drops an older one of this id."""
        self.end(number)
        if len(self._open) >= MAX_BUNDLES:
            raise refusals.out_of_bundles(
                f"{MAX_BUNDLES} bundles are open: commit or discard some",
            )
        self._open[number] = Bundle()

    def end(self, number: int) -> Bundle:
        """Forget a bundle and return it; an empty one if there is none."""
        bundle = self._open.pop(number, Bundle())
        self._bytes -= sum(len(member.envelope) for member in bundle.members)
        return bundle

    def of(self, message: bytes) -> tuple[Bundle, bytes]:
        """Return the bundle that a BUNDLE_ADD_MESSAGE is for and the message in it.

        Like the bridge, open it if it is not yet. Raise Refusal if there is too much in all.
        """
        number, member = packets.bundle_member(message)
        if number not in self._open:
            self.begin(number)
        if self._bytes + len(message) > MAX_BYTES:
            raise refusals.bundles_too_large(
                f"more than {MAX_BYTES} bytes in bundles",
            )
        return self._open[number], member

    def add(self, bundle: Bundle, member: Member) -> None:
        bundle.members.append(member)
        self._bytes += len(member.envelope)


def require_supported(member: bytes) -> int:
    """Return the type of a message for a bundle; raise Refusal if none may hold it."""
    kind = member[1]
    if kind not in (ofp.OFPT_FLOW_MOD, ofp.OFPT_PORT_MOD, ofp.OFPT_GROUP_MOD):
        raise refusals.not_in_a_bundle(
            f"a bundle cannot hold a message of type {kind}",
        )
    return kind
