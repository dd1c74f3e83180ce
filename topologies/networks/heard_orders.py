"""Orders to cut or mend links that are over when the controller has heard of it.

net.configLinkStatus("q1", "q2", "up")     the next session finds the fibre
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from mininet.net import Mininet

from topologies.nodes import QuantumController
from topologies.system.processes.programs import NetworkError
from topologies.system.runs import runtime
from topologies.system.runs.console import answer_of
from topologies.system.runs.runtime import CONSOLE, Runtime
from topologies.timeouts import HEARD_TIMEOUT_S, POLL_S
from wire.config import Fiber
from wire.controller_lines import ConsoleError
from wire.malformed import MalformedPacket

MESSAGES_OF_A_LINK = 8  # that wait for each other at most: ports, then LLDP both ways


class SwitchEnd(NamedTuple):
    """The end of a fibre at a quantum switch, as the controller's console names it."""

    dpid: str
    port: int


class HeardOrders(Mininet):
    """Mininet whose `link` waits for the controller, once the network has started."""

    hears = False  # whether the controller does

    def configLinkStatus(self, src: str, dst: str, status: str) -> None:  # noqa: N802 (Mininet's)
        """Cut or mend the links between two nodes; raise NetworkError if that is not heard of."""
        network = runtime.current()
        ours = any(isinstance(controller, QuantumController) for controller in self.controllers)
        ends = ends_between(src, dst, network.fibers, network.own_datapath_ids)
        if not (self.hears and ours and ends and status in ("down", "up")):
            super().configLinkStatus(src, dst, status)
            return
        with until_heard(lambda: console_of(network), ends, status == "up", patience_s(network)):
            super().configLinkStatus(src, dst, status)


def patience_s(network: Runtime) -> float:
    return network.patience_s(HEARD_TIMEOUT_S, MESSAGES_OF_A_LINK)


def console_of(network: Runtime) -> Any:
    """Return what the controller says of paths and fibres; raise NetworkError for no answer."""
    console = Path(network.socket(CONSOLE))
    try:
        return answer_of(console, "paths")
    except (OSError, MalformedPacket, ConsoleError) as error:
        raise NetworkError(f"the controller does not answer at {console} ({error})") from error


def ends_between(
    a: str, b: str, fibers: Iterable[Fiber], datapath_ids: Mapping[str, int]
) -> dict[SwitchEnd, str]:
    """Return the ends at switches of the fibres between two nodes, with their names.

    None of those that end at a switch which is not of these: our controller does not know them.
    """
    by_end: dict[SwitchEnd, str] = {}
    for fiber in fibers:
        ends = [end for end in (fiber.a, fiber.b) if end.port.isdecimal()]
        if {fiber.a.node, fiber.b.node} == {a, b} and all(end.node in datapath_ids for end in ends):
            by_end |= {
                SwitchEnd(f"{datapath_ids[end.node]:016x}", int(end.port)): (
                    f"{end.node}-eth{end.port}"
                )
                for end in ends
            }
    return by_end


@contextmanager
def until_heard(
    ask: Callable[[], Any], ends: Mapping[SwitchEnd, str], up: bool, limit_s: float
) -> Iterator[None]:
    """Let fibres be cut or mended within, and wait until the controller takes them for that.

    `ask` returns what its console says of fibres. Of a network that has just started it finds them
    first. Raise NetworkError if it takes longer than `limit_s`.
    """

    def wait(what: str, missing: Callable[[Mapping[SwitchEnd, bool]], Iterable[SwitchEnd]]) -> None:
        deadline = time.monotonic() + limit_s
        while late := list(missing(_whole(ask()))):
            if time.monotonic() > deadline:
                names = ", ".join(sorted(ends[each] for each in late))
                raise NetworkError(
                    f"the controller had no report in {limit_s:.0f} s of {what} {names}: "
                    "`qmn devices` shows which switches it knows"
                )
            time.sleep(POLL_S)

    wait("the fibre at", lambda whole: ends.keys() - whole.keys())
    yield
    state = "mended" if up else "cut"
    wait(f"the {state} fibre at", lambda whole: [e for e in ends if whole.get(e) != up])


def _whole(state: Any) -> dict[SwitchEnd, bool]:
    return {SwitchEnd(each["dpid"], each["port"]): each["up"] for each in state["fibers"]}
