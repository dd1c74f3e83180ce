"""Orders about links wait until the controller has heard of what they did."""

from typing import Any

import pytest

from topologies.networks.heard_orders import SwitchEnd, ends_between, until_heard
from topologies.system.processes.programs import NetworkError
from wire.config import Fiber
from wire.parameters.fiber import FiberEnd, optics

IDS = {"q1": 0x1001, "q2": 0x1002}
ENDS = {
    SwitchEnd("0000000000001001", 3): "q1-eth3",
    SwitchEnd("0000000000001002", 4): "q2-eth4",
}


class Console:
    """A controller that passes on the reports of both ends, one after the other."""

    def __init__(self, *report: tuple[bool, bool]) -> None:
        self.left = list(report)

    def ask(self) -> Any:
        """Return what is next."""
        both = zip(ENDS, self.left.pop(0), strict=True)
        return {"fibers": [{"dpid": end.dpid, "port": end.port, "up": up} for end, up in both]}


@pytest.mark.parametrize("up", [True, False])
def test_an_order_is_over_when_both_ends_were_heard_of(up: bool) -> None:
    before, half, done = (not up, not up), (up, not up), (up, up)
    console = Console(before, before, before, half, done, done)
    with until_heard(console.ask, ENDS, up, 20.0):
        pass
    assert console.left == [done]


def test_what_is_never_heard_of_is_named() -> None:
    ask = Console((False, False), (True, False)).ask
    words = "no report in 0 s of the mended fibre at q2-eth4: .*qmn devices"
    with pytest.raises(NetworkError, match=words), until_heard(ask, ENDS, True, 0.0):
        pass


def test_no_order_is_given_about_a_fibre_that_is_not_found() -> None:
    given = []
    words = "no report in 0 s of the fibre at q1-eth3, q2-eth4"
    with (
        pytest.raises(NetworkError, match=words),
        until_heard(lambda: {"fibers": []}, ENDS, True, 0.0),
    ):
        given.append("up")
    assert not given


def test_the_ends_of_all_fibres_between_two_nodes_are_found_also_of_hosts() -> None:
    plain = optics("fibre")
    between, of_alice, other = (
        Fiber.joining(FiberEnd(*a), FiberEnd(*b), plain)
        for a, b in (
            (("q1", "3"), ("q2", "4")),
            (("alice", "alice-q0"), ("q1", "2")),
            (("q2", "5"), ("bob", "bob-q0")),
        )
    )
    fibers = [between, of_alice, other]
    assert ends_between("q2", "q1", fibers, IDS) == ENDS
    assert ends_between("alice", "q1", fibers, IDS) == {SwitchEnd(f"{0x1001:016x}", 2): "q1-eth2"}
    assert ends_between("alice", "bob", fibers, IDS) == {}
    others = {"q2": IDS["q2"]}  # another controller programs q1
    assert ends_between("q2", "q1", fibers, others) == {}
