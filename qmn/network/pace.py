"""The choice of how a network's time passes: stepped, unless something in it goes by the wall."""

from collections.abc import Iterable, Iterator

from qmn.network.options import NetworkOptions
from qmn.network.time_scale import STEPPED, Pace
from qmn.options import BadInput
from topologies.description.content import Content

DELAYS = ("controller_delay", "host_delay", "switch_agent_delay")


def pace_of(options: NetworkOptions, reasons: Iterable[str]) -> Pace:
    """Return how time passes; `reasons` are against steps.

    Raise BadInput for stepped time if there is one, and for paced time if an option is of stepped
    time.
    """
    reason, pace = next(iter(reasons), ""), Pace.of(options.time)
    if options.time and pace.stepped and reason:
        raise BadInput(f"--time {STEPPED}: {reason}; leave it out")
    if pace.stepped and not reason:
        return pace
    for name in DELAYS:
        if getattr(options, name):
            remedy = f"here {reason}" if pace.stepped else f"leave --time {options.time} out"
            flag = f"--{name.replace('_', '-')}"
            raise BadInput(f"{flag} is exact in stepped time alone: {remedy}")
    return Pace(False, reason=reason) if pace.stepped else pace


def against_steps(options: NetworkOptions, content: Content) -> Iterator[str]:
    """Yield why a network cannot be stepped: the gate cannot see it, or the wall paces it."""
    if options.control_loss:
        yield "TCP repeats by the wall what --control-loss loses"
    if options.sabot:
        yield "what runs in the server of --sabot cannot be seen"
    if options.apps:
        yield "--app modules have timers of their own"
    for link in content.links:
        if link.info.get("loss"):
            yield f"TCP repeats by the wall what {link} loses"
    for name, node in content.nodes.items():
        if node.info.get("hardware"):
            yield f"the instrument of {name} runs in real time"
        if node.info.get("qnic") and not options.time:
            yield f"the QNIC of {name} may count a time of its own"
