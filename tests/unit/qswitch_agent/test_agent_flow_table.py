"""The cross-connects that a flow table asks for, and what a FLOW_MOD makes of it."""

import itertools
from typing import Any

import openflow_messages as of
import pytest
from openflow_messages import CLASSICAL, FIBERS
from os_ken.ofproto import ofproto_v1_4 as ofp

from qswitch_agent.hardware.optics import CrossConnect
from qswitch_agent.middleware.flow_table import UNMARKED, FlowTable, circuit_of
from qswitch_agent.openflow import matches
from qswitch_agent.openflow.flow_reports import ADDED, PAUSED, REMOVED, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry, FlowMod
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.refusals import Refusal

LLDP = bytes.fromhex("80000a0288cc")
MODIFY = {"command": ofp.OFPFC_MODIFY}
DELETE = {"command": ofp.OFPFC_DELETE}


def entry(
    in_port: int | None,
    out_port: int | None,
    priority: int = 100,
    other: bytes = b"",
    cookie: int = 0,
    mark: Mark | None = None,
) -> FlowEntry:
    match = b"" if in_port is None else matches.of_port(in_port)
    return FlowEntry(priority, match + other, in_port, bool(other), out_port, cookie, mark)


def table(*entries: FlowEntry) -> FlowTable:
    table = FlowTable(FIBERS)
    for one in entries:
        table.apply(FlowUpdate(ADDED, one))
    return table


def pairs(table: FlowTable) -> set[tuple[int, int]]:
    plan = table.plan()
    assert not plan.refused
    return {(path.in_port, path.out_port) for path in plan.cross_connects}


def paths(*entries: FlowEntry) -> set[tuple[int, int]]:
    return pairs(table(*entries))


def modify(fields: dict[str, Any], out_port: int, **more: Any) -> FlowMod:
    return of.mod(fields, of.outputs(out_port), **MODIFY, **more)


def test_light_goes_to_inner_ports_and_comes_from_memories_alone() -> None:
    table = FlowTable(FIBERS, [60_001, 60_002, 61_001]).copy()
    for one in (entry(1, 60_001), entry(2, 61_001), entry(60_001, 3), entry(61_001, 60_002)):
        table.apply(FlowUpdate(ADDED, one))
    assert pairs(table) == {(1, 60_001), (2, 61_001), (61_001, 60_002)}
    assert table.set_fiber(60_002, whole=False)  # the port is set down
    assert pairs(table) == {(1, 60_001), (2, 61_001)}


def test_empty_table_asks_for_nothing() -> None:
    assert paths() == set()


def test_paths_become_cross_connects() -> None:
    assert paths(entry(1, 2), entry(2, 3), entry(3, 1)) == {(1, 2), (2, 3), (3, 1)}


def test_photons_are_counted_under_the_number_in_the_mark() -> None:
    plan = table(entry(1, 2, mark=Mark(0, 77))).plan()
    assert plan.cross_connects == {CrossConnect(1, 2, 77)}


def test_entry_that_came_past_the_agent_has_a_number_of_its_own() -> None:
    first, second = circuit_of(entry(1, 2)), circuit_of(entry(1, 3, cookie=1))
    assert first != second
    assert min(first, second) >= UNMARKED
    assert max(first, second) < 1 << 32


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
    assert pairs(both) == {(1, 2)}
    both.apply(FlowUpdate(REMOVED, entry(1, None, 1)))
    assert pairs(both) == set()


def test_entry_of_the_same_match_and_priority_is_replaced() -> None:
    assert paths(entry(1, 2), entry(1, 3)) == {(1, 3)}


def test_no_light_passes_a_cut_fibre_until_it_is_mended() -> None:
    three = table(entry(1, 2), entry(2, 3), entry(4, 1))
    assert three.set_fiber(3, whole=False)
    assert pairs(three) == {(1, 2), (4, 1)}
    assert three.set_fiber(1, whole=False)
    assert pairs(three.copy()) == set()
    assert three.set_fiber(3, whole=True)
    assert pairs(three) == {(2, 3)}


def test_only_news_of_fibres_is_news() -> None:
    none = table()
    assert not none.set_fiber(1, whole=True)
    assert not none.set_fiber(9, whole=False)
    assert none.set_fiber(1, whole=False)
    assert not none.set_fiber(1, whole=False)


def test_pause_changes_nothing() -> None:
    one = table(entry(1, 2))
    one.apply(FlowUpdate(PAUSED))
    assert pairs(one) == {(1, 2)}


def test_two_paths_into_one_port_conflict_whatever_their_order() -> None:
    entries = [entry(3, 4, 5), entry(1, 4, 5), entry(2, 4, 1)]
    for order in itertools.permutations(entries):
        plan = table(*order).plan()
        assert [path[:2] for path in plan.cross_connects] == [(1, 4)]
        assert list(plan.refused.values()) == [
            "no path from port 3 to port 4: the path from port 1 ends there",
            "no path from port 2 to port 4: the path from port 1 ends there",
        ]


def test_what_is_stuck_keeps_its_ports_from_others_and_from_nobody_else() -> None:
    one = table(entry(1, 2), entry(3, 4))
    for stuck, expected in {(1, 3): {(3, 4)}, (4, 2): {(3, 4)}, (1, 2): {(1, 2), (3, 4)}}.items():
        one.stuck = frozenset({stuck})
        for plan in (one.plan(), one.copy().plan()):
            assert {path[:2] for path in plan.cross_connects} == expected
            assert {path[:2] for path in plan.refused} == {(1, 2), (3, 4)} - expected
    one.stuck = frozenset({(4, 2)})
    assert list(one.plan().refused.values()) == [
        "no path from port 1 to port 2: the cross-connect 4->2 is stuck"
    ]


def test_path_that_is_not_met_takes_no_port() -> None:
    assert paths(entry(1, 4, 1), entry(1, 3, 2), entry(2, 4, 1)) == {(1, 3), (2, 4)}


def test_only_entries_on_fibre_ports_that_are_no_paths_are_foreign() -> None:
    foreign = [entry(1, None), entry(1, 9), entry(1, 1)]
    welcome = [entry(1, 2), entry(9, None), entry(None, None), entry(1, None, other=LLDP)]
    welcome += [entry(1, None, mark=Mark(0, 1))]
    seen = [table().is_foreign(FlowUpdate(ADDED, one)) for one in foreign + welcome]
    assert seen == [True] * 3 + [False] * 5
    assert not table().is_foreign(FlowUpdate(REMOVED, foreign[0]))


def test_only_light_has_a_mark_that_counts() -> None:
    mark = Mark(1, 2)
    light = entry(1, 2, mark=mark)
    others = [entry(CLASSICAL, 10, mark=mark), entry(None, 10, mark=mark)]
    both = table(light, entry(2, None, 100, LLDP, mark=mark), *others)
    assert both.marked() == [light]
    assert both.copy().marked() == [light]
    both.apply(FlowUpdate(REMOVED, light))
    assert both.marked() == []


def test_entry_is_found_by_priority_and_match() -> None:
    one = entry(1, 2)
    assert table(one).find(100, matches.of_port(1)) == one
    assert table(one).find(101, matches.of_port(1)) is None


def test_change_of_a_copy_leaves_the_table_alone() -> None:
    before = table(entry(1, 2))
    trial = before.copy()
    report = of.mod({"in_port": 3}, of.outputs(4), priority=7)
    assert trial.change(report) == [report]
    assert (pairs(trial), pairs(before)) == ({(1, 2), (3, 4)}, {(1, 2)})


def test_entry_by_the_older_name_of_its_port_replaces_the_other() -> None:
    one = table(entry(1, 2, 0x8000))
    message = of.light(1, 3)
    older = matches.join(bytes.fromhex("00000002 0001"))
    mod = FlowMod.decode(message[:48] + older + message[64:]).marked(Mark(0, 5))
    one.change(mod)
    assert pairs(one) == {(1, 3)}


@pytest.mark.parametrize(
    ("fields", "more", "left"),
    [
        ({}, {}, set()),
        ({"in_port": 1}, {}, {(2, 3)}),
        ({"in_port": 1, "eth_type": 0x88CC}, {}, {(1, 2), (2, 3)}),
        ({"in_port": 9}, {}, {(1, 2), (2, 3)}),
        ({}, {"out_port": 3}, {(1, 2)}),
        ({}, {"out_group": 3}, {(1, 2), (2, 3)}),
        ({}, {"cookie": 5, "cookie_mask": 0xF}, {(2, 3)}),
        ({}, {"cookie": 4, "cookie_mask": 0xF}, {(1, 2), (2, 3)}),
        ({}, {"table_id": ofp.OFPTT_ALL}, set()),
        ({}, {"table_id": 1}, {(1, 2), (2, 3)}),
    ],
)
def test_delete_removes_what_its_match_and_filters_cover(
    fields: dict[str, Any], more: dict[str, Any], left: set[tuple[int, int]]
) -> None:
    two = table(entry(1, 2, cookie=0x15), entry(2, 3, cookie=0x6))
    mod = of.mod(fields, **DELETE, **more)
    assert two.change(mod) == [mod]
    assert pairs(two) == left


def test_strict_delete_removes_one_priority_and_one_match() -> None:
    two = table(entry(1, 2, 7), entry(1, 3, 8), entry(1, None, 7, LLDP))
    for fields, priority in (({"in_port": 1}, 9), ({}, 8)):
        two.change(of.mod(fields, command=ofp.OFPFC_DELETE_STRICT, priority=priority))
        assert pairs(two) == {(1, 3)}
    two.change(of.mod({"in_port": 1}, command=ofp.OFPFC_DELETE_STRICT, priority=8))
    assert pairs(two) == {(1, 2)}
    assert two.find(7, matches.of_port(1) + LLDP)


def test_modify_keeps_cookie_mark_and_time_outs_of_each_entry() -> None:
    marks = Mark(30, 77), Mark(0, 78)
    entries = [entry(1, 2, 7, cookie=5, mark=marks[0]), entry(1, 3, 8, cookie=6, mark=marks[1])]
    two = table(*entries, entry(2, 1))
    report = two.change(modify({"in_port": 1}, 4, idle_timeout=3, cookie=9))
    assert [(one.command, one.priority, one.cookie) for one in report] == [
        (ofp.OFPFC_MODIFY_STRICT, 7, 5),
        (ofp.OFPFC_MODIFY_STRICT, 8, 6),
    ]
    assert [one.instructions.data for one in report] == [
        of.light_instructions(mark, 4) for mark in marks
    ]
    assert {one.idle_timeout_s for one in report} == {0}
    assert pairs(two) == {(1, 4), (2, 1)}
    assert {(one.mark, one.cookie) for one in two.marked()} == {(marks[0], 5), (marks[1], 6)}


def test_modify_of_nothing_adds_nothing() -> None:
    one = table(entry(1, 2))
    for mod in (
        modify({"in_port": 3}, 4),
        modify({"in_port": 1}, 4, cookie=1, cookie_mask=1),
        of.mod({"in_port": 1}, of.outputs(4), command=ofp.OFPFC_MODIFY_STRICT, priority=9),
    ):
        assert one.change(mod) == [mod]
    assert pairs(one) == {(1, 2)}


def test_strict_modify_changes_one_entry() -> None:
    two = table(entry(1, 2, 7), entry(1, 3, 8))
    (report,) = two.change(
        of.mod({"in_port": 1}, of.outputs(4), command=ofp.OFPFC_MODIFY_STRICT, priority=7)
    )
    assert report.priority == 7
    two.change(of.mod({"in_port": 1}, command=ofp.OFPFC_DELETE_STRICT, priority=8))
    assert pairs(two) == {(1, 4)}


def test_modify_to_nothing_makes_the_entry_dark() -> None:
    one = table(entry(1, 2, mark=Mark(0, 3)))
    (report,) = one.change(of.mod({"in_port": 1}, **MODIFY))
    assert report.instructions.data == of.light_instructions(Mark(0, 3), None)
    assert pairs(one) == set()


def test_modify_of_everything_does_not_change_light() -> None:
    one = table(entry(1, 2), entry(None, None, 0))
    with pytest.raises(Refusal) as refusal:
        one.change(modify({}, ofp.OFPP_LOCAL))
    assert (refusal.value.kind, refusal.value.code) == (
        ofp.OFPET_BAD_ACTION,
        ofp.OFPBAC_BAD_OUT_PORT,
    )
    assert pairs(one) == {(1, 2)}


def test_modify_does_not_change_lldp_along_with_light() -> None:
    for entries in ([entry(1, 2), entry(1, None, other=LLDP)], [entry(1, None, other=LLDP)]):
        with pytest.raises(Refusal, match="LLDP from port 1") as refusal:
            table(*entries).change(modify({"in_port": 1}, 3))
        error = refusal.value.kind, refusal.value.code
        assert error == (ofp.OFPET_BAD_MATCH, ofp.OFPBMC_BAD_FIELD)


def test_modify_of_classical_entries_passes() -> None:
    mixed = table(entry(1, 2), entry(CLASSICAL, 10), entry(None, 10, 0, LLDP))
    for fields in ({"in_port": CLASSICAL}, {"eth_type": 0x88CC}):
        mod = modify(fields, ofp.OFPP_LOCAL)
        assert mixed.change(mod) == [mod]
    assert pairs(mixed) == {(1, 2)}
