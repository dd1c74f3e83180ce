"""The wait for a controller that has just started to find all switches and fibres."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from mininet.net import Mininet
from mininet.node import Switch

from topologies.system.processes.programs import NetworkError
from topologies.system.runs.runtime import Runtime
from topologies.timeouts import CUT_LOOK_S, CUT_S, DISCOVERY_TIMEOUT_S, POLL_S
from wire.config import Fiber
from wire.controller_lines import NewFacts

MESSAGES_OF_A_START = 40
LEAST_FIBERS_PER_S = 20  # that a controller finds beside the first
INTERFACES = Path("/sys/class/net")


class Discovery:
    """Fibres that a controller is to find, and those it has found."""

    def __init__(self, net: Mininet, network: Runtime) -> None:
        self._net, self._runtime = net, network
        others = network.programmed_elsewhere
        mine = [fiber for fiber in network.fibers if not others & {fiber.a.node, fiber.b.node}]
        self._fibers = {self._named(fiber): fiber for fiber in mine}
        switches = [switch for switch in net.switches if switch.name not in others]
        self._switches = {f"switch {int(switch.dpid, 16):#x}" for switch in switches}

    def wait(self, check: Callable[[], None]) -> None:
        """Wait until all is found; meanwhile `check` raises if something makes that useless.

        Raise NetworkError if it is not found in time, or cannot be: a fibre that is cut.
        """
        least_s = DISCOVERY_TIMEOUT_S + len(self._fibers) / LEAST_FIBERS_PER_S
        limit_s = self._runtime.patience_s(least_s, MESSAGES_OF_A_START)
        with closing(NewFacts(self._runtime.logs)) as facts:
            self._wait(facts, limit_s, check)

    def _wait(self, facts: NewFacts, limit_s: float, check: Callable[[], None]) -> None:
        began = time.monotonic()
        unknown, look_again = self._switches | self._fibers.keys(), began
        cut_since: dict[str, float] = {}
        while unknown := unknown - found(facts.read()):
            check()
            now = time.monotonic()
            if now >= look_again:
                cut_since = {name: cut_since.get(name, now) for name in self._cut(unknown)}
                refuse_cut(cut_since, now)
                look_again = now + CUT_LOOK_S
            if now > began + limit_s:
                raise NetworkError(
                    f"the controller did not find {', '.join(sorted(unknown))} in "
                    f"{limit_s:g} s; its log: {self._runtime.logs}/c0.log"
                )
            time.sleep(max(POLL_S, time.monotonic() - now))  # half of the time is the controller's

    def _named(self, fiber: Fiber) -> str:
        """Return a fibre's name: the host's interface, or both ends between switches."""
        dpids = self._runtime.datapath_ids
        for end in (fiber.a, fiber.b):
            if end.node not in dpids:
                return end.port
        return link_name((dpids[end.node], int(end.port)) for end in (fiber.a, fiber.b))

    def _cut(self, names: set[str]) -> Iterator[str]:
        """Yield those of the names whose fibre is down at a switch of it, by the port, too."""
        for name in names & self._fibers.keys():
            for end in (self._fibers[name].a, self._fibers[name].b):
                node = self._net.get(end.node)
                if not isinstance(node, Switch):
                    continue
                port = str(node.intfs[int(end.port)])
                if not up(port):
                    yield f"{name} at {port}"


@contextmanager
def heard_again(network: Runtime, switch: Any, starts: bool) -> Iterator[None]:
    """Start a switch meanwhile, and wait until the controller has heard of it, if it is to.

    Raise NetworkError if it has not in time.
    """
    ours = switch.name not in network.programmed_elsewhere
    waits = starts and ours and not switch.stands
    with closing(NewFacts(network.logs)) as facts:
        facts.read()
        yield
        limit_s = network.patience_s(DISCOVERY_TIMEOUT_S, MESSAGES_OF_A_START)
        deadline = time.monotonic() + limit_s
        while waits and f"switch {int(switch.dpid, 16):#x}" not in found(facts.read()):
            if time.monotonic() > deadline:
                raise NetworkError(f"the controller did not find {switch.name} in {limit_s:g} s")
            time.sleep(POLL_S)


def refuse_cut(since: Mapping[str, float], now: float) -> None:
    """Raise NetworkError for a fibre that is seen cut for too long."""
    for name, first in since.items():
        if now - first > CUT_S:
            raise NetworkError(f"the fibre {name} was cut before the controller found it")


def found(facts: Iterable[dict[str, Any]]) -> set[str]:
    """Return the switches and fibres that these facts of the controller's record tell of."""
    names = set()
    for fact in facts:
        match fact["event"]:
            case "switch":
                names.add(f"switch {fact['dpid']:#x}")
            case "fiber":
                names.add(fact["port"])
            case "link":
                names.add(link_name(fact["ends"]))
    return names


def up(interface: str) -> bool:
    try:
        # A link between machines (VXLAN) does not know, except when it was set down.
        return (INTERFACES / interface / "operstate").read_text().strip() in ("up", "unknown")
    except FileNotFoundError:
        return False


def link_name(ends: Iterable[Sequence[int]]) -> str:
    return " to ".join(f"{dpid:#x}:{port}" for dpid, port in sorted(map(tuple, ends)))
