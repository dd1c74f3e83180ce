"""Which cross-connects a flow table asks for."""

import itertools

from qswitch_agent.hardware.optics import CrossConnect
from qswitch_agent.middleware import FlowTable
from qswitch_agent.openflow import ADDED, PAUSED, REMOVED, FlowEntry, FlowUpdate

LLDP = b"\x80\x00\x0a\x02\x88\xcc"


def entry(
    in_port: int | None, out_port: int | None, priority: int = 100, other: bytes = b""
) -> FlowEntry:
    match = b"" if in_port is None else b"in_port" + in_port.to_bytes(4, "big")
    return FlowEntry(priority, match + other, in_port, bool(other), out_port)


def table(*entries: FlowEntry) -> FlowTable:
    table = FlowTable([1, 2, 3, 4])
    for one in entries:
        table.apply(FlowUpdate(ADDED, one))
    return table


def paths(*entries: FlowEntry) -> set[tuple[int, int]]:
    plan = table(*entries).plan()
    assert plan.conflicts == ()
    return set(plan.cross_connects)


def test_empty_table_asks_for_nothing() -> None:
    assert paths() == set()


def test_paths_become_cross_connects() -> None:
    assert paths(entry(1, 2), entry(2, 3), entry(3, 1)) == {(1, 2), (2, 3), (3, 1)}


def test_ports_that_are_no_fibres_are_ignored() -> None:
    assert paths(entry(9, 2), entry(1, 9), entry(1, 0xFFFFFFFD)) == set()


def test_light_is_not_sent_back() -> None:
    assert paths(entry(1, 1)) == set()


def test_light_does_not_meet_entries_for_packets() -> None:
    assert paths(entry(1, 2, 1), entry(1, 3, 200, LLDP), entry(None, None, 65535, LLDP)) == {(1, 2)}


def test_higher_priority_decides() -> None:
    assert paths(entry(1, 2, 1), entry(1, 3, 2)) == {(1, 3)}


def test_drop_of_higher_priority_closes_the_path() -> None:
    assert paths(entry(1, 2, 1), entry(1, None, 2)) == set()
    assert paths(entry(1, 2, 1), entry(None, None, 2)) == set()


def test_table_miss_entry_leaves_paths_alone() -> None:
    assert paths(entry(None, None, 0), entry(1, 2, 1)) == {(1, 2)}


def test_match_for_any_port_is_no_path() -> None:
    assert paths(entry(None, 2)) == set()


def test_removed_entry_closes_its_path_and_uncovers_the_next() -> None:
    both = table(entry(1, 2, 1), entry(1, 3, 2))
    both.apply(FlowUpdate(REMOVED, entry(1, None, 2)))
    assert both.plan().cross_connects == {(1, 2)}
    both.apply(FlowUpdate(REMOVED, entry(1, None, 1)))
    assert both.plan().cross_connects == set()


def test_entry_of_the_same_match_and_priority_is_replaced() -> None:
    assert paths(entry(1, 2), entry(1, 3)) == {(1, 3)}


def test_no_light_passes_a_cut_fibre_until_it_is_mended() -> None:
    three = table(entry(1, 2), entry(2, 3), entry(4, 1))
    assert three.set_fiber(3, whole=False)
    assert three.plan().cross_connects == {(1, 2), (4, 1)}
    assert three.set_fiber(1, whole=False)
    assert three.plan().cross_connects == set()
    assert three.set_fiber(3, whole=True)
    assert three.plan().cross_connects == {(2, 3)}


def test_only_news_of_fibres_is_news() -> None:
    none = table()
    assert not none.set_fiber(1, whole=True)
    assert not none.set_fiber(9, whole=False)
    assert none.set_fiber(1, whole=False)
    assert not none.set_fiber(1, whole=False)


def test_pause_changes_nothing() -> None:
    one = table(entry(1, 2))
    one.apply(FlowUpdate(PAUSED))
    assert one.plan().cross_connects == {(1, 2)}


def test_two_paths_into_one_port_conflict_whatever_their_order() -> None:
    entries = [entry(3, 4, 5), entry(1, 4, 5), entry(2, 4, 1)]
    for order in itertools.permutations(entries):
        plan = table(*order).plan()
        assert plan.cross_connects == {CrossConnect(1, 4)}
        assert plan.conflicts == (
            "no path from port 3 to port 4: the path from port 1 ends there",
            "no path from port 2 to port 4: the path from port 1 ends there",
        )


def test_only_entries_on_fibre_ports_that_are_no_paths_are_foreign() -> None:
    foreign = [entry(1, None), entry(1, 9), entry(1, 2, other=LLDP)]
    welcome = [entry(1, 2), entry(9, None), entry(None, None)]
    seen = [table().is_foreign(FlowUpdate(ADDED, one)) for one in foreign + welcome]
    assert seen == [True] * 3 + [False] * 3
    assert not table().is_foreign(FlowUpdate(REMOVED, foreign[0]))
