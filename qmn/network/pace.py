"""The choice of how a network's time passes: stepped, unless something in it goes by the wall."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from qmn.network.options import NetworkOptions
from qmn.network.time_scale import PACED, REAL, STEPPED, Pace
from qmn.options import BadInput
from topologies.description.content import Content

DELAYS = ("controller_delay", "host_delay", "switch_agent_delay")


def pace_of(options: NetworkOptions, paced: Pace, reasons: Iterable[str]) -> Pace:
    """Return how time passes; `paced` is how it passes if it is not stepped.

    Raise BadInput for stepped time if there is a reason against it, and for paced time if an
    option is of stepped time.
    """
    reason = next(iter(reasons), "")
    if options.time == STEPPED and reason:
        raise BadInput(f"--time {STEPPED}: {reason}; leave it out")
    if options.time != PACED and not reason:
        return replace(paced, stepped=True)
    for name in DELAYS:
        if getattr(options, name):
            remedy = f"here {reason}" if reason else f"leave --time {PACED} out"
            flag = f"--{name.replace('_', '-')}"
            raise BadInput(f"{flag} is exact in stepped time alone: {remedy}")
    return replace(paced, reason=paced.reason or ("" if options.time else reason))


def against_steps(options: NetworkOptions, content: Content) -> Iterator[str]:
    """Yield why a network cannot be stepped: the gate cannot see it, or the wall paces it."""
    if options.time_scale != REAL:
        yield "--time-scale is of paced time"
    if options.control_loss:
        yield "TCP repeats by the wall what --control-loss loses"
    if options.sabot:
        yield "what runs in the server of --sabot cannot be seen"
    if options.policy:
        yield "the controller looks at a --policy by the wall"
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
