"""Barriers: when the flow monitor is asked what it has reported, and what goes with a reply."""

from collections.abc import Callable

import openflow_messages as of
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import Stage, play, stage

from qswitch_agent.openflow import flows, packets
from qswitch_agent.openflow.flow_reports import ADDED, REMOVED, FlowUpdate
from qswitch_agent.openflow.flows import FlowMod
from qswitch_agent.proxy import link

ALL = {"command": ofp.OFPFC_DELETE}


def reported(mod: FlowMod, event: int = ADDED) -> FlowUpdate:
    """Return the monitor's report of an entry of a FLOW_MOD."""
    entry = flows.entry(mod.priority, mod.match, mod.instructions, mod.cookie)
    return FlowUpdate(event, entry)


async def committed(now: Stage, *members: bytes) -> list[FlowMod]:
    """Let a controller commit a bundle with a barrier behind; return the messages to the bridge."""
    asked = [*of.bundle(5, *members), of.barrier_request(7)]
    now.controller.says(*asked)
    reports = [await now.bridge.next() for _message in asked]
    assert reports[-1] == asked[-1]
    inner = [packets.bundle_member(each)[1] for each in reports[1:-2]]
    return [FlowMod.decode(each) for each in inner]


async def answered(now: Stage) -> None:
    """Let the bridge answer the barrier, and the controller hear it."""
    now.bridge.says(of.barrier_reply(7))
    await now.controller.hears(of.barrier_reply(7))


def test_bridge_is_not_asked_for_what_its_monitor_has_reported() -> None:
    async def scene() -> None:
        async with stage() as now:
            mods = await committed(now, of.light(1, 2, 51), of.light(2, 1, 52))
            now.switch.paths.update(map(reported, mods))
            await answered(now)
            assert now.reports.asked == 0
            assert now.optics.paths == {(1, 2), (2, 1)}

    play(scene())


def test_light_of_a_reported_bundle_is_waited_for() -> None:
    async def scene() -> None:
        async with stage() as now:
            now.optics.free.clear()
            mods = await committed(now, of.light(1, 2, 51))
            now.switch.paths.update(map(reported, mods))
            now.bridge.says(of.barrier_reply(7))
            await now.controller.hears_nothing()
            now.optics.free.set()
            await now.controller.hears(of.barrier_reply(7))
            assert (now.reports.asked, now.optics.paths) == (0, {(1, 2)})

    play(scene())


@pytest.mark.parametrize("part", [0, 1])
def test_bridge_is_asked_if_a_part_is_not_reported(part: int) -> None:
    async def scene() -> None:
        async with stage() as now:
            mods = await committed(now, of.light(1, 2, 51), of.light(2, 1, 52))
            now.switch.paths.update([reported(mods[part])])
            now.reports.waiting.append(reported(mods[1 - part]))
            await answered(now)
            assert now.reports.asked == 1
            assert now.optics.paths == {(1, 2), (2, 1)}

    play(scene())


async def added(now: Stage) -> FlowMod:
    (mod,) = await committed(now, of.light(1, 2, 51, cookie=3))
    now.switch.paths.update([reported(mod)])
    await answered(now)
    return mod


async def deleted(now: Stage, report: Callable[[FlowUpdate], None]) -> None:
    mod = await added(now)
    now.controller.says(of.flow_mod({}, xid=6, **ALL), of.barrier_request(7))
    await now.bridge.next()
    await now.bridge.hears(of.barrier_request(7))
    report(reported(mod, REMOVED))
    await answered(now)
    assert now.optics.paths == set()


def test_bridge_is_asked_what_is_left_until_deletions_are_reported() -> None:
    async def scene(waits: bool) -> None:
        async with stage() as now:
            if waits:
                await deleted(now, now.reports.waiting.append)
            else:
                await deleted(now, lambda update: now.switch.paths.update([update]))
            assert now.reports.asked == waits

    play(scene(waits=True))
    play(scene(waits=False))


def test_entry_that_was_there_before_is_not_taken_for_its_like() -> None:
    async def scene() -> None:
        async with stage() as now:
            before = await added(now)
            (mod,) = await committed(now, of.light(1, 2, 51, cookie=3))
            assert mod == before
            now.reports.waiting.append(reported(mod))
            await answered(now)
            assert now.reports.asked == 1

    play(scene())


def test_bridge_is_asked_what_becomes_of_changes_that_are_passed_on_unread() -> None:
    async def scene() -> None:
        async with stage() as now:
            (mod,) = await committed(now, of.light(1, 2, 51))
            unread = of.flow_mod({"in_port": 9}, of.outputs(ofp.OFPP_FLOOD))
            now.controller.says(unread, of.barrier_request(8))
            await now.bridge.hears(unread, of.barrier_request(8))
            now.switch.paths.update([reported(mod)])
            now.bridge.says(of.barrier_reply(7), of.barrier_reply(8))
            await now.controller.hears(of.barrier_reply(7), of.barrier_reply(8))
            assert now.reports.asked == 2

    play(scene())


def test_bridge_is_asked_while_another_controllers_change_is_not_reported() -> None:
    async def scene() -> None:
        async with stage() as now:
            bridge, other = await now.connect()
            (mod,) = await committed(now, of.light(1, 2, 51))
            other.says(of.flow_mod({}, xid=6, **ALL))
            await bridge.next()
            now.switch.paths.update([reported(mod)])
            await answered(now)
            assert now.reports.asked == 1
            for end in (bridge, other):
                end.writer.close()

    play(scene())


def test_replies_before_a_barriers_go_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "SHOW_SOON_S", 3600.0)
    reply = of.bundle_control(5, ofp.OFPBCT_COMMIT_REPLY, 50)

    async def scene() -> None:
        async with stage() as now:
            mods = await committed(now, of.light(1, 2, 51))
            now.switch.paths.update(map(reported, mods))
            now.bridge.says(reply)
            await now.controller.hears_nothing()
            now.bridge.says(of.barrier_reply(7))
            await now.controller.hears(reply, of.barrier_reply(7))
            now.bridge.says(reply)  # nothing is owed any more
            await now.controller.hears(reply)

    play(scene())


def test_replies_do_not_wait_long_for_a_barriers() -> None:
    reply = of.bundle_control(5, ofp.OFPBCT_COMMIT_REPLY, 50)

    async def scene() -> None:
        async with stage() as now:
            await committed(now, of.light(1, 2, 51))
            now.bridge.says(reply)
            await now.controller.hears(reply)

    play(scene())


def test_replies_that_wait_for_a_barriers_are_said_before_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(link, "SHOW_SOON_S", 3600.0)
    reply = of.bundle_control(5, ofp.OFPBCT_COMMIT_REPLY, 50)

    async def scene() -> None:
        async with stage() as now:
            await committed(now, of.light(1, 2, 51))
            now.bridge.says(reply)
            await now.controller.hears_nothing()
            now.controller.says(b"\x00" * 8)  # no length
            await now.controller.hears(reply)
            await now.controller.hears_the_end()

    play(scene())
