"""Bundles through the proxy: judged as a whole at COMMIT, and passed on or discarded as a whole."""

import asyncio

import openflow_messages as of
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from proxy_scene import Stage, play, stage

from qswitch_agent.hardware.optics import Direction, HardwareRefusal
from qswitch_agent.openflow import matches, messages, packets
from qswitch_agent.openflow.flow_reports import ADDED, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry, FlowMod
from qswitch_agent.openflow.instructions import Mark
from qswitch_agent.openflow.messages import encode
from qswitch_agent.openflow.refusals import Refusal
from qswitch_agent.proxy import bundles
from qswitch_agent.proxy.bundles import Bundles, require_supported
from qswitch_agent.proxy.link import PRIVATE_XID

ECHO = encode(ofp.OFPT_ECHO_REQUEST, 3, b"are you there?")
OWN_BARRIER = encode(ofp.OFPT_BARRIER_REQUEST, PRIVATE_XID)
OWN_REPLY = encode(ofp.OFPT_BARRIER_REPLY, PRIVATE_XID)
COMMIT = ofp.OFPBCT_COMMIT_REQUEST
DISCARD = ofp.OFPBCT_DISCARD_REQUEST
MARK = Mark(30, 7)
MODIFY = {"command": ofp.OFPFC_MODIFY}


def has(now: Stage, in_port: int, out_port: int) -> None:
    """Let the table have a path."""
    match = matches.of_port(in_port)
    entry = FlowEntry(0x8000, match, in_port, False, out_port, 0, MARK)
    now.switch.paths.update([FlowUpdate(ADDED, entry)])


async def member(now: Stage) -> bytes:
    """Return the member of a bundle that the bridge hears of next."""
    message = await now.bridge.next()
    assert message[1] == ofp.OFPT_BUNDLE_ADD_MESSAGE, message.hex()
    _number, inner = packets.bundle_member(message)
    assert inner[4:8] == message[4:8]
    return inner


async def member_mod(now: Stage) -> FlowMod:
    return FlowMod.decode(await member(now))


async def is_discarded(now: Stage, number: int, xid: int = 50) -> None:
    """Check that the bridge has to forget a bundle, and let it answer."""
    message = await now.bridge.next()
    assert packets.bundle_control(message)[:2] == (number, DISCARD)
    await now.bridge.hears(OWN_BARRIER)
    now.bridge.says(of.bundle_control(number, ofp.OFPBCT_DISCARD_REPLY, xid), OWN_REPLY)


async def fails(now: Stage, commit: bytes, bad: bytes | None, kind: int = 0, code: int = 0) -> None:
    """Check the errors of a refused bundle: the member's, then the bundle's."""
    if bad is not None:
        await now.controller.hears(messages.error(kind, code, bad))
    failed = ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_FAILED
    await now.controller.hears(messages.error(*failed, commit))


def test_paths_of_a_bundle_are_passed_on_with_their_marks() -> None:
    async def scene() -> None:
        async with stage() as now:
            scene = of.bundle(5, of.light(1, 2, 51, idle_timeout=9), of.light(2, 1, 52))
            now.controller.says(*scene)
            await now.bridge.hears(scene[0])
            mods = [await member_mod(now) for _member in range(2)]
            assert [mod.instructions.outputs for mod in mods] == [(2,), (1,)]
            assert [mod.instructions.mark.idle_timeout_s for mod in mods if mod.instructions.mark]
            await now.bridge.hears(scene[-1])
            reply = of.bundle_control(5, ofp.OFPBCT_COMMIT_REPLY, 50)
            now.bridge.says(reply)
            await now.controller.hears(reply)

    play(scene())


def test_path_may_be_moved_in_one_bundle() -> None:
    async def scene() -> None:
        async with stage() as now:
            has(now, 1, 2)
            delete = of.flow_mod({"in_port": 1}, xid=51, command=ofp.OFPFC_DELETE)
            scene = of.bundle(5, delete, of.light(3, 2, 52))
            now.controller.says(*scene)
            await now.bridge.hears(scene[0])
            assert await member(now) == delete
            await member_mod(now)
            await now.bridge.hears(scene[-1])

    play(scene())


@pytest.mark.parametrize(
    ("bad", "kind", "code"),
    [
        (
            of.flow_mod({"in_port": 3}, of.outputs(4, 2), xid=52),
            ofp.OFPET_BAD_ACTION,
            ofp.OFPBAC_TOO_MANY,
        ),
        (of.group_mod(3, xid=52), ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT),
        (of.packet_out(of.LLDP, 3, xid=52), ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_UNSUP),
        (
            of.port_mod(3, of.tuning(1), xid=52),
            ofp.OFPET_BAD_PROPERTY,
            ofp.OFPBPC_BAD_VALUE,
        ),
        (encode(ofp.OFPT_FLOW_MOD, 52, b"cut short"), ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_BAD_LEN),
        (
            of.flow_mod({"in_port": 3}, xid=52, command=ofp.OFPFC_DELETE)[:48]
            + matches.join(2 * matches.of_port(3)),
            ofp.OFPET_BAD_MATCH,
            ofp.OFPBMC_DUP_FIELD,
        ),
    ],
)
def test_member_that_light_cannot_do_is_refused_when_it_is_added(
    bad: bytes, kind: int, code: int
) -> None:
    """OpenFlow 1.4, 7.3.9.7: a member is validated when it is added, and stored if it can be."""

    async def scene() -> None:
        async with stage() as now:
            bad_member = messages.with_body(bad, bad[8:])
            scene = of.bundle(5, of.light(1, 2, 51), bad_member, of.light(2, 1, 53))
            now.controller.says(*scene[:-1])
            await now.controller.hears(messages.error(kind, code, bad_member))
            await now.bridge.hears(scene[0])
            mods = [await member_mod(now) for _member in range(2)]
            assert [mod.instructions.outputs for mod in mods] == [(2,), (1,)]
            now.controller.says(scene[-1])
            await now.bridge.hears(scene[-1])

    play(scene())


def test_conflict_is_blamed_on_the_last_path_of_the_bundle() -> None:
    async def scene() -> None:
        async with stage() as now:
            has(now, 1, 2)
            last = of.light(3, 2, 52)
            scene = of.bundle(5, of.light(4, 1, 51), last)
            now.controller.says(*scene)
            await now.bridge.hears(scene[0])
            for _member in range(2):
                await member_mod(now)
            await is_discarded(now, 5)
            taken = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT
            await fails(now, scene[-1], last, *taken)

    play(scene())


def test_path_that_is_asked_for_once_more_in_vain_is_refused_and_hinders_no_other() -> None:
    """An entry for it stands, as a controller may have left it: both 1 and 3 want port 2."""

    async def scene() -> None:
        async with stage() as now:
            has(now, 1, 2)
            has(now, 3, 2)
            once_more = of.light(3, 2, 52)
            scene = of.bundle(5, of.light(4, 1, 51), once_more)
            now.controller.says(*scene)
            await now.bridge.hears(scene[0])
            for _member in range(2):
                await member_mod(now)
            await is_discarded(now, 5)
            taken = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT
            await fails(now, scene[-1], once_more, *taken)
            other = of.bundle(6, of.light(4, 1, 61))
            now.controller.says(*other)
            await now.bridge.hears(other[0])
            await member_mod(now)
            await now.bridge.hears(other[-1])

    play(scene())


def test_bundle_that_one_refused_member_would_have_opened_is_the_bridges_matter() -> None:
    async def scene() -> None:
        async with stage() as now:
            bad = of.packet_out(of.LLDP, 3, xid=51)
            add, commit = of.bundle_add(5, bad), of.bundle_control(5, COMMIT, 50)
            now.controller.says(add, commit)
            unsupported = ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_UNSUP
            await now.controller.hears(messages.error(*unsupported, bad))
            await now.bridge.hears(commit)

    play(scene())


def test_modification_waits_for_commit_and_names_each_entry() -> None:
    async def scene() -> None:
        async with stage() as now:
            modify = of.flow_mod({"in_port": 1}, of.outputs(3), xid=51, **MODIFY)
            behind = of.light(2, 4, 52)
            open_, *adds, commit = of.bundle(5, modify, behind)
            now.controller.says(open_, *adds)
            await now.bridge.hears(open_)
            has(now, 1, 2)
            now.controller.says(ECHO, commit)
            await now.bridge.hears(ECHO)
            report = await member_mod(now)
            assert (report.command, report.priority) == (ofp.OFPFC_MODIFY_STRICT, 0x8000)
            assert report.instructions.data == of.light_instructions(MARK, 3)
            await now.bridge.hears(OWN_BARRIER)
            now.bridge.says(OWN_REPLY)
            assert (await member_mod(now)).instructions.outputs == (4,)
            await now.bridge.hears(OWN_BARRIER)
            now.bridge.says(OWN_REPLY)
            await now.bridge.hears(commit)

    play(scene())


def test_late_member_that_the_bridge_refuses_fails_the_bundle() -> None:
    async def scene() -> None:
        async with stage() as now:
            has(now, 1, 2)
            modify = of.flow_mod({"in_port": 1}, of.outputs(3), xid=51, **MODIFY)
            scene = of.bundle(5, modify)
            now.controller.says(*scene)
            await now.bridge.hears(scene[0])
            await member_mod(now)
            await now.bridge.hears(OWN_BARRIER)
            wrong = messages.error(ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_TYPE, modify)
            now.bridge.says(wrong, OWN_REPLY)
            await now.controller.hears(wrong)
            await is_discarded(now, 5)
            await fails(now, scene[-1], None)

    play(scene())


def test_bundle_tunes_ports_when_it_is_committed() -> None:
    async def scene() -> None:
        async with stage() as now:
            tune = of.port_mod(2, of.tuning(193_400_000, -50), xid=51)
            scene = of.bundle(5, tune)
            now.controller.says(*scene)
            await now.bridge.hears(scene[0], scene[-1])
            assert now.optics.tuned == []
            reply = of.bundle_control(5, ofp.OFPBCT_COMMIT_REPLY, 50)
            now.bridge.says(reply)
            await now.controller.hears(reply)
            assert now.optics.tuned == [(2, 193_400_000, -5.0, Direction.BOTH)]
            now.bridge.says(reply)
            await now.controller.hears(reply)
            assert len(now.optics.tuned) == 1

    play(scene())


@pytest.mark.parametrize("kind", [ofp.OFPBCT_OPEN_REPLY, ofp.OFPBCT_CLOSE_REPLY])
def test_port_is_not_tuned_by_a_reply_that_is_no_commit(kind: int) -> None:
    async def scene() -> None:
        async with stage() as now:
            scene = of.bundle(5, of.port_mod(2, of.tuning(193_400_000, -50), xid=51))
            now.controller.says(*scene)
            await now.bridge.hears(scene[0], scene[-1])
            # Of the same xid, which a controller may use for the whole bundle.
            early = of.bundle_control(5, kind, 50)
            now.bridge.says(early)
            await now.controller.hears(early)
            assert now.optics.tuned == []
            reply = of.bundle_control(5, ofp.OFPBCT_COMMIT_REPLY, 50)
            now.bridge.says(reply)
            await now.controller.hears(reply)
            assert now.optics.tuned == [(2, 193_400_000, -5.0, Direction.BOTH)]

    play(scene())


def test_tuning_with_a_wrong_address_is_not_in_the_bundle() -> None:
    async def scene() -> None:
        async with stage() as now:
            message = of.port_mod(2, of.tuning(193_400_000), xid=51)
            tune = message.replace(of.ADDRESS, bytes(6))
            scene = of.bundle(5, tune)
            now.controller.says(*scene)
            wrong = ofp.OFPET_PORT_MOD_FAILED, ofp.OFPPMFC_BAD_HW_ADDR
            await now.controller.hears(messages.error(*wrong, tune))
            await now.bridge.hears(scene[0], scene[-1])
            now.bridge.says(of.bundle_control(5, ofp.OFPBCT_COMMIT_REPLY, 50))
            await now.controller.next()
            assert now.optics.tuned == []

    play(scene())


@pytest.mark.parametrize("outcome", ["refused by the bridge", "refused by the hardware"])
def test_port_is_not_tuned_by_a_bundle_that_fails(outcome: str) -> None:
    async def scene() -> None:
        async with stage() as now:
            scene = of.bundle(5, of.port_mod(2, of.tuning(193_400_000), xid=51))
            now.controller.says(*scene)
            await now.bridge.hears(scene[0], scene[-1])
            failed = ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_FAILED
            reply = of.bundle_control(5, ofp.OFPBCT_COMMIT_REPLY, 50)
            if outcome == "refused by the bridge":
                reply = messages.error(*failed, scene[-1])
            else:
                now.optics.failure = HardwareRefusal("too far")
            now.bridge.says(reply)
            answer = of.decoded(await now.controller.next())
            assert isinstance(answer, parser.OFPErrorMsg)
            assert (answer.xid, answer.type, answer.code) == (50, *failed)
            assert now.optics.tuned == []

    play(scene())


def test_discarded_bundle_changes_nothing() -> None:
    async def scene() -> None:
        async with stage() as now:
            discard = of.bundle_control(5, DISCARD, 50)
            open_, add, commit = of.bundle(5, of.light(1, 2, 51))
            now.controller.says(open_, add, discard, commit)
            await now.bridge.hears(open_)
            await member_mod(now)
            await now.bridge.hears(discard, commit)
            reply = of.bundle_control(5, ofp.OFPBCT_DISCARD_REPLY, 50)
            now.bridge.says(reply)
            await now.controller.hears(reply)

    play(scene())


def test_control_of_a_bundle_is_passed_on_without_what_is_behind() -> None:
    async def scene() -> None:
        async with stage() as now:
            discard = of.bundle_control(5, DISCARD, 50)
            now.controller.says(messages.with_body(discard, discard[8:] + b"more"))
            await now.bridge.hears(discard)

    play(scene())


def test_member_of_another_xid_is_refused_at_once() -> None:
    async def scene() -> None:
        async with stage() as now:
            add = of.bundle_add(5, of.light(1, 2, 51), xid=52)
            now.controller.says(add, ECHO)
            bad_xid = ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_BAD_XID
            await now.controller.hears(messages.error(*bad_xid, add))
            await now.bridge.hears(ECHO)

    play(scene())


def test_connection_that_ends_at_commit_leaves_nobody_waiting() -> None:
    async def scene() -> None:
        async with stage() as now:
            has(now, 1, 2)
            scene = of.bundle(5, of.light(3, 2, 51))
            now.controller.says(*scene)
            await now.bridge.hears(scene[0])
            await member_mod(now)
            await now.bridge.next()
            (ended,) = now.switch.connections
            now.bridge.writer.close()
            await now.controller.hears_the_end()
            while now.switch.connections:
                await asyncio.sleep(0)
            async with now.switch.trial(ended) as trial:
                assert len(trial.plan().cross_connects) == 1

    play(scene())


def test_too_many_bundles_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bundles, "MAX_BUNDLES", 2)
    several = Bundles()
    for number in (1, 2, 2):
        several.begin(number)
    with pytest.raises(Refusal) as refusal:
        several.begin(3)
    error = refusal.value.kind, refusal.value.code
    assert error == (ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_OUT_OF_BUNDLES)
    several.end(1)
    several.begin(3)


def test_too_many_bytes_are_refused_until_a_bundle_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    add = of.bundle_add(1, of.light(1, 2))
    monkeypatch.setattr(bundles, "MAX_BYTES", 2 * len(add))
    several = Bundles()
    for _time in range(2):
        bundle, inner = several.of(add)
        several.add(bundle, bundles.Member(inner, add))
    with pytest.raises(Refusal) as refusal:
        several.of(add)
    error = refusal.value.kind, refusal.value.code
    assert error == (ofp.OFPET_BUNDLE_FAILED, ofp.OFPBFC_MSG_TOO_MANY)
    for _bundle in range(2):  # each has room for as many bytes as the first
        assert len(several.end(1).members) == 2
        for _time in range(2):
            bundle, inner = several.of(add)
            assert inner == of.light(1, 2)
            several.add(bundle, bundles.Member(inner, add))
        with pytest.raises(Refusal):
            several.of(add)


def test_bundles_hold_changes_of_flows_ports_and_groups_alone() -> None:
    for message in (of.light(1, 2), of.port_mod(1), of.group_mod(9)):
        assert require_supported(message) == message[1]
    for message in (of.packet_out(of.LLDP, 1), of.barrier_request(1), messages.hello()):
        with pytest.raises(Refusal):
            require_supported(message)
