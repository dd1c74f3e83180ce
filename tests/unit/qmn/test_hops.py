"""Fibres and light paths, hop by hop."""

from qmn.scripting.light import fiber_state, light_path
from wire.dispatcher_pb2 import SwitchCondition, SwitchStatisticsReply
from wire.outcomes import Pauli
from wire.parameters.fiber import Fiber, FiberEnd

ALICE = Fiber(FiberEnd("alice", "alice-q0"), FiberEnd("q1", "2"), length_km=5, loss_db_per_km=0.2)
MIDDLE = Fiber(FiberEnd("q1", "3"), FiberEnd("q2", "4"), length_km=10, loss_db_per_km=0.2)
BOB = Fiber(FiberEnd("bob", "bob-q1"), FiberEnd("q2", "5"), connectors_db=0.5)
FIBERS = [ALICE, MIDDLE, BOB]
NAMES = {0x1001: "q1", 0x1002: "q2"}
PATH = {
    "session": "0000000000000007",
    "begin": "alice-q0",
    "hops": [
        {"dpid": "0000000000001001", "in_port": 2, "out_port": 3},
        {"dpid": "0000000000001002", "in_port": 4, "out_port": 5},
    ],
}


def conditions() -> dict[str, SwitchCondition]:
    """Return q1, whose path 2 to 3 differs from its others, and q2."""
    q1 = SwitchCondition(loss_db=9, rotation=Pauli.I)
    q1.paths.add(in_port=2, out_port=3, loss_db=0.75, rotation=Pauli.X)
    q1.paths.add(in_port=3, out_port=2, loss_db=8, rotation=Pauli.I)
    return {"q1": q1, "q2": SwitchCondition(loss_db=1.25, rotation=Pauli.Z)}


def test_a_path_goes_through_fibres_and_switches_to_its_end() -> None:
    path = light_path(PATH, FIBERS, NAMES, conditions())
    assert [(hop.what, hop.begin, hop.end) for hop in path.hops] == [
        ("fibre", "alice-q0", "q1:2"),
        ("q1", "q1:2", "q1:3"),
        ("fibre", "q1:3", "q2:4"),
        ("q2", "q2:4", "q2:5"),
        ("fibre", "q2:5", "bob-q1"),
    ]


def test_loss_adds_up_and_rotations_combine() -> None:
    path = light_path(PATH, FIBERS, NAMES, conditions())
    assert [hop.loss_db for hop in path.hops] == [1.0, 0.75, 2.0, 1.25, 0.5]
    assert path.loss_db == 5.5
    assert path.rotation is Pauli.XZ


def statistics() -> dict[str, SwitchStatisticsReply]:
    """Return what two switches count and measure."""
    q1, q2 = SwitchStatisticsReply(), SwitchStatisticsReply()
    q1.ports.add(port=2, photons_in=100, photons_out=20, photons_lost=7, rx_power_dbm=-1.5)
    q1.ports.add(port=3, photons_in=5, photons_out=90, power_dbm=-3, rx_power_dbm=-2)
    q2.ports.add(port=4, photons_in=60, photons_out=6, photons_lost=1, rx_power_dbm=-5)
    return {"q1": q1, "q2": q2}


def test_a_fibre_of_a_host_loses_what_its_switch_misses_of_0_dbm() -> None:
    state = fiber_state(ALICE, statistics(), {("q1", 2): True, ("q1", 3): False})
    assert (state.a, state.b, state.loss_db, state.up) == ("alice-q0", "q1:2", 1.5, True)
    assert (state.photons_to_a, state.photons_to_b, state.lost_in_switches) == (20, 100, 7)


def test_a_fibre_between_switches_loses_what_the_far_end_misses_of_what_was_launched() -> None:
    state = fiber_state(MIDDLE, statistics(), {("q1", 3): True, ("q2", 4): False})
    assert (state.loss_db, state.up) == (2.0, False)
    assert (state.photons_to_a, state.photons_to_b, state.lost_in_switches) == (5, 60, 1)


def test_of_a_fibre_without_a_switch_nobody_counts() -> None:
    fiber = Fiber(FiberEnd("alice", "alice-q9"), FiberEnd("bob", "bob-q9"), connectors_db=2)
    state = fiber_state(fiber, statistics(), {})
    assert (state.loss_db, state.up, state.photons_to_b) == (2.0, None, None)
