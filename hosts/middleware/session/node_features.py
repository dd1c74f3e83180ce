"""The features of both ends of a session, compared with those that its service needs."""

from hosts.middleware.session.errors import SessionError, unsupported
from hosts.middleware.session.protocol import HostSide, OpenerSide, Say, Side, Steps
from hosts.middleware.session.protocol import hear as hear_numbers
from hosts.middleware.session.values import NUMBERS, Lifetimes
from wire.features import STORE, Feature, NodeFeatures, names
from wire.light import Role
from wire.malformed import MalformedPacket
from wire.metadata.setup import Setup
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Reason, Service
from wire.services import needs

MAX_NUMBER = (1 << 32) - 1
REMEDIES = {
    Reason.FIBER_CUT: "has a fibre that is cut, and none to take its place: mend it (`link … up`)",
    Reason.CANNOT_EMIT: "has no source of light (feature emit): take another host in its place, or "
    "give it one (source.statistics); memories that emit share pairs by a station (docs/nodes.md)",
    Reason.CANNOT_STORE: "has no memory, or one that is too small (feature store): take another "
    "host in its place, or give it one (memory.capacity)",
    Reason.CANNOT_GATE: "has no gates but Pauli operators (feature gate): take another host in its "
    "place, or give it some (gates.kind)",
    Reason.CANNOT_MEASURE: "has no detectors that click (feature measure): take another host in "
    "its place, or give it some (detectors.efficiency)",
    Reason.CANNOT_HERALD: "has no memory whose qubits emit (feature herald): take another host in "
    "its place, or give it one (emitter.scheme)",
    Reason.CANNOT_ABSORB: "has a memory that emits, and takes in no light from elsewhere (feature "
    "absorb): let a station herald pairs (docs/nodes.md), take another host in its place, or give "
    "it such a memory (memory.kind absorptive)",
    Reason.CANNOT_INTERFERE: "is not a relay in which light of others interferes (feature "
    "interfere): take another host in its place, or give it an analyser (analyser.kind linear)",
}


def refusal(setup: Setup, hosts: dict[str, str]) -> SessionError:
    """Return why the controller has refused a set-up; hosts: names to addresses."""
    reason, service = Reason(setup.reason), Service(setup.service)
    if reason not in REMEDIES:
        return SessionError(reason)
    unable = next((name for name, at in hosts.items() if at == setup.source), setup.source)
    return SessionError(reason, f"{service.name.lower()}: {unable} {REMEDIES[reason]}")


def are_told(service: Service) -> bool:
    """Return whether the acceptor begins by telling them: where it stores pairs."""
    return STORE in needs(service, Role.ACCEPTOR)


def say(side: HostSide) -> Say:
    """Tell the opener, and how large blocks may be: the controller may have granted less."""
    ours, times = side.node_features, side.lifetimes.numbers()
    numbers = [side.setup.pairs, ours.features.value, ours.memory_qubits, *times]
    return side.say(Topic.NODE_FEATURES, 0, numbers, 32)


def hear(side: Side) -> Steps[tuple[int, NodeFeatures, Lifetimes]]:
    """Return how large blocks may be, and what the acceptor can do; or raise SessionError."""
    numbers = yield from hear_numbers(Topic.NODE_FEATURES, 0, 3 + NUMBERS, MAX_NUMBER)
    pairs, bits, memory_qubits, *rest = numbers.tolist()
    if not 0 < pairs <= side.setup.pairs:
        text = f"blocks of {pairs} pairs, {side.setup.pairs} were asked for"
        raise SessionError(Reason.PROTOCOL, text)
    try:
        return pairs, NodeFeatures.checked(bits, memory_qubits), Lifetimes.of(rest, side.peer)
    except MalformedPacket as error:
        raise SessionError(Reason.PROTOCOL, f"{side.peer}: {error}") from error


def capacity(side: OpenerSide) -> int:
    return side.node_features.both(side.theirs).memory_qubits


def require_capacity(side: OpenerSide, pairs: int, spare: int) -> None:
    """Raise SessionError unless `pairs` pairs fit into both memories, with spare ones."""
    if pairs + spare <= capacity(side):
        return
    least, who = min((has.memory_qubits, who) for has, who in _ends(side))
    more = f" and {spare} more, to estimate or purify," if spare else ""
    raise unsupported(
        f"{pairs} pairs{more} do not fit into the memory of {who}, {least} qubits: ask for at most "
        f"{max(least - spare, 0)} at a time, or give it a larger one (memory.capacity)",
    )


def require(side: OpenerSide, feature: Feature, what: str, remedy: str) -> None:
    """Raise SessionError unless both ends have a feature; what needs it is named."""
    for has, who in _ends(side):
        if feature not in has.features:
            raise unsupported(
                f"{what} needs the feature {names(feature)} at both ends, and {who} has only "
                f"{names(has.features)}: {remedy}",
            )


def _ends(side: OpenerSide) -> tuple[tuple[NodeFeatures, str], tuple[NodeFeatures, str]]:
    return (side.node_features, side.host), (side.theirs, side.other_host)
