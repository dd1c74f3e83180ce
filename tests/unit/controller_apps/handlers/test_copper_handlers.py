"""Classical switches and copper: their tables, who may speak, what is learned and forwarded."""

import struct
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import handlers_scene
import pytest
from handlers_scene import (
    BROADCAST,
    ONE,
    TWO,
    UNFILTERED,
    Datapath,
    Scene,
    ethernet,
    fiber_port,
    flow_mods,
    instructions,
    reconnect,
)
from metadata_scene import (
    ALICE,
    BOB,
    CHARLIE,
    FRAMED,
    MACS,
    Q1,
    S1,
    frame,
)
from scapy.layers.l2 import ARP, Ether

from controller_apps.console.questions import EventQuestion
from controller_apps.openflow.framework import ofproto
from wire.config import Station
from wire.device import DEVICE_PORT
from wire.metadata.header import METADATA_PORT, QUANTUM_SWITCHES

scene, ready = handlers_scene.scene, handlers_scene.ready  # fixtures


def test_a_classical_switch_gets_its_tables(scene: Scene) -> None:
    entries = flow_mods(scene.s1.take())
    added = [entry for entry in entries if entry.command == ofproto.OFPFC_ADD]
    wiped = [entry.table_id for entry in entries if entry.command == ofproto.OFPFC_DELETE]
    up, on = ("output", ofproto.OFPP_CONTROLLER), ("goto", 2)
    ends = {"eth_type": 0x0800, "ip_proto": 6}
    to_port, from_port = {**ends, "tcp_dst": METADATA_PORT}, {**ends, "tcp_src": METADATA_PORT}
    expected = [
        (2, 0, {}, [up]),
        (0, 0, {}, [("goto", 1)]),
        (1, 0, {}, [on]),
        (1, 250, {**to_port, "tcp_flags": (2, 23)}, [on]),
        (1, 200, to_port, [up, ("goto", 3)]),
        (1, 200, {"eth_type": 0x0800, "ip_proto": 17, "udp_dst": DEVICE_PORT}, [up]),
        (1, 200, {"eth_type": 0x88B6, "eth_dst": ("0f" + 5 * ":00", "ff" + 5 * ":00")}, [up]),
        (1, 400, {**to_port, "tcp_flags": (1, 1)}, [up, on]),
        (1, 400, {**to_port, "tcp_flags": (4, 4)}, [up, on]),
        (1, 400, {**from_port, "tcp_flags": (4, 4)}, [up, on]),
        (1, 400, {**from_port, "tcp_flags": (18, 18)}, [up, on]),
        (1, 500, {"eth_type": 0x8100}, []),
        (1, 500, {"eth_type": 0x88A8}, []),
        (1, 500, {**ends, "tcp_src": 0, "tcp_dst": 0}, []),
        (1, 500, {"eth_dst": QUANTUM_SWITCHES}, []),
    ]
    assert wiped == [2, 0, 1, 3]
    assert [
        (entry.table_id, entry.priority, dict(entry.match.items()), instructions(entry))
        for entry in added
    ] == expected
    for entry in added:
        for instruction in entry.instructions:
            if instruction.type == ofproto.OFPIT_APPLY_ACTIONS:
                assert instruction.actions[0].max_len == ofproto.OFPCML_NO_BUFFER


def added_to(
    datapath: Datapath, priorities: set[int], copies: bool = False
) -> list[tuple[dict[str, Any], list[Any]]]:
    """Return match and actions of the entries of these priorities, and of table 3's."""
    mods = [
        mod
        for mod in flow_mods(datapath.take())
        if mod.priority in priorities or (copies and (mod.table_id, mod.priority) == (3, 200))
    ]
    applied = [(dict(mod.match.items()), mod.instructions[-1].actions) for mod in mods]
    return [
        (match, [getattr(action, "port", None) or action.value for action in actions])
        for match, actions in applied
    ]


def test_copies_pass_a_meter_which_is_made_anew(tmp_path: Path) -> None:
    """OpenFlow 1.4 section 7.3.4.4: a drop band of 200 packets a second, 2,000 at once."""
    sent = Scene(tmp_path, trunks=[(S1, 5), (Q1, 1)]).s1.take()
    meters = [message for message in sent if message.kind == ofproto.OFPT_METER_MOD]
    (copied,) = [mod for mod in flow_mods(sent) if (mod.table_id, mod.priority) == (3, 200)]
    metered = copied.instructions[0].meter_id
    head, band = struct.pack("!HI", 0b0110, metered), struct.pack("!HHII4x", 1, 16, 200, 2000)
    wanted = [struct.pack("!H", 2) + head, struct.pack("!H", 0) + head + band]
    assert [meter.data[8:] for meter in meters] == wanted
    assert sent.index(meters[-1]) < sent.index(copied)


def test_what_is_pushed_is_copied_along_the_trunks_to_quantum_switches(tmp_path: Path) -> None:
    trunks = [(S1, 5), (S1, 6), (Q1, 1)]
    scene, up = Scene(tmp_path, trunks=trunks), ofproto.OFPP_CONTROLLER
    to_port = {"eth_type": 0x0800, "ip_proto": 6, "tcp_dst": METADATA_PORT}
    to_group = {"eth_dst": QUANTUM_SWITCHES}
    assert added_to(scene.s1, {510}, copies=True) == [
        ({**to_port, "tcp_flags": (8, 8)}, [QUANTUM_SWITCHES, 5, 6]),
        ({"in_port": 5, **to_group}, [6]),
        ({"in_port": 6, **to_group}, [5]),
    ]
    assert added_to(scene.q1, {200}) == [({"in_port": 1, **to_port, **to_group}, [up])]
    off = Scene(tmp_path, trunks=trunks, metadata_at_switch="off")
    assert added_to(off.s1, {510}, copies=True) == added_to(off.q1, {200}) == []


@pytest.mark.parametrize("copied", [True, False])
def test_a_grant_says_which_switches_have_seen_the_setup(tmp_path: Path, copied: bool) -> None:
    scene, asked = Scene(tmp_path, trunks=[(S1, 5), (Q1, 1)]), frame(FRAMED.encode())
    scene.announce()
    if copied:
        scene.packet_in(scene.q1, 1, asked, table=0)
    scene.packet_in(scene.s1, 1, asked)
    scene.barrier(scene.q1.take()[-1].xid)
    (granted,) = [line for line in scene.recorded() if line["event"] == "granted"]
    assert granted["copies_ms"].keys() == {"q1"}
    assert granted["copies_ms"]["q1"] <= 0 if copied else granted["copies_ms"]["q1"] is None


def test_each_switch_is_asked_for_the_table_that_sessions_have_entries_in(scene: Scene) -> None:
    for switch, table in ((scene.s1, 1), (scene.q1, 0)):
        (asked,) = [m for m in switch.take() if getattr(m, "multipart", None) == ofproto.OFPMP_FLOW]
        assert asked.body[0] == table


def filtering(messages: list[Any]) -> list[tuple[int, dict[str, Any], list[tuple[str, int]]]]:
    """Return priority, match and instructions of the entries of the first table."""
    wiped, *added = [mod for mod in flow_mods(messages) if mod.table_id == 0]
    assert (wiped.command, dict(wiped.match.items())) == (ofproto.OFPFC_DELETE, {})
    return [(mod.priority, dict(mod.match.items()), instructions(mod)) for mod in added]


def test_stations_speak_for_themselves_unless_the_policy_lets_them(tmp_path: Path) -> None:
    on = [("goto", 1)]
    port, own = {"in_port": 1}, {"in_port": 1, "eth_src": MACS[ALICE]}
    arp = {"eth_type": 0x0806, "arp_sha": MACS[ALICE], "arp_spa": ALICE}
    expected = [
        (0, {}, on),
        (40, {**own, "eth_type": 0x0800, "ipv4_src": ALICE}, on),
        (40, {**own, **arp}, on),
        (30, {**port, "eth_type": 0x0800}, []),
        (30, {**port, "eth_type": 0x0806}, []),
        (30, {**port, "eth_type": 0x86DD}, []),
        (20, own, on),
        (10, port, []),
    ]
    scene = Scene(tmp_path, policy="")
    assert filtering(scene.s1.take()) == expected  # bob is at another switch
    for policy, entries in ((UNFILTERED, expected[:1]), ("", expected)):
        scene.policy_path.write_text(policy)
        question = EventQuestion("reload", {})
        scene.quantum.asked(question)
        question.wait()
        assert filtering(scene.s1.take()) == entries
        assert scene.quantum.arbiter.terms.policy.filter.handshakes == (policy == "")


def test_copper_of_a_quantum_switch_learns_like_any_other(scene: Scene) -> None:
    copper = fiber_port(7, optics=None)
    q1 = reconnect(scene, fiber_port(1), copper, fiber_port(2))
    entries = [m for m in q1.take() if m.kind == ofproto.OFPT_FLOW_MOD and m.priority == 1]
    assert [dict(entry.match.items()) for entry in entries] == [{"in_port": 7}]
    assert [instructions(entry) for entry in entries] == [[("goto", 2)]]
    frame = bytes.fromhex("ffffffffffff0200000000aa0800") + bytes(46)
    scene.packet_in(q1, 7, frame, table=2)
    (out,) = [m for m in q1.take() if m.kind == ofproto.OFPT_PACKET_OUT]
    assert (out.in_port, out.port, out.frame) == (7, ofproto.OFPP_FLOOD, frame)


def test_unknown_stations_are_flooded_and_known_ones_learned(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, ethernet(ONE, BROADCAST), table=2)
    (flooded,) = ready.s1.take()
    assert (flooded.in_port, flooded.port) == (1, ofproto.OFPP_FLOOD)
    assert flooded.frame == ethernet(ONE, BROADCAST)
    ready.packet_in(ready.s1, 2, ethernet(TWO, ONE), table=2)
    entry, sent = ready.s1.take()
    assert (sent.in_port, sent.port) == (2, 1)
    assert dict(entry.match.items()) == {
        "in_port": 2,
        "eth_src": "02:00:00:00:00:02",
        "eth_dst": "02:00:00:00:00:01",
    }
    assert (entry.table_id, instructions(entry)) == (2, [("output", 1)])
    assert entry.idle_timeout > 0


def test_arp_asks_the_port_that_a_station_must_be_at_and_all_for_others(tmp_path: Path) -> None:
    def asked(scene: Scene, in_port: int, address: str, operation: int = 1) -> int:
        message = ARP(op=operation, hwsrc=MACS[CHARLIE], psrc=CHARLIE, pdst=address)
        broadcast = Ether(src=MACS[CHARLIE], dst="ff:ff:ff:ff:ff:ff")
        scene.s1.take()
        scene.packet_in(scene.s1, in_port, bytes(broadcast / message), table=2)
        return int(scene.s1.take()[-1].port)

    scene = Scene(tmp_path, policy="")
    assert asked(scene, 3, ALICE) == 1
    assert asked(scene, 3, BOB) == ofproto.OFPP_FLOOD  # bob is at another switch
    assert asked(scene, 1, ALICE) == ofproto.OFPP_FLOOD  # who tells of itself
    assert asked(scene, 3, ALICE, operation=2) == ofproto.OFPP_FLOOD
    scene.policy_path.write_text(UNFILTERED)  # then anybody may be anywhere
    question = EventQuestion("reload", {})
    scene.quantum.asked(question)
    question.wait()
    assert asked(scene, 3, ALICE) == ofproto.OFPP_FLOOD


def test_a_station_that_moves_is_found_again(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, ethernet(ONE, BROADCAST), table=2)
    ready.packet_in(ready.s1, 3, ethernet(ONE, BROADCAST), table=2)
    _, deleted, _ = ready.s1.take()
    assert (deleted.command, deleted.table_id) == (ofproto.OFPFC_DELETE, 2)
    assert dict(deleted.match.items()) == {"eth_dst": "02:00:00:00:00:01"}
    assert ready.learning.mac_table.port_of(S1, ONE.to_bytes(6, "big")) == 3


def test_link_local_frames_and_stumps_are_not_forwarded(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, ethernet(ONE, 0x0180C200000E), table=2)
    ready.packet_in(ready.s1, 1, b"\0" * 11, table=2)
    assert ready.s1.take() == []


def test_each_app_leaves_the_other_ones_packets_alone(ready: Scene) -> None:
    ready.packet_in(ready.s1, 1, frame(b"no magic"), table=1)
    assert ready.s1.take() == []
    assert ready.quantum.journal.dropped == {"malformed": 1}
    ready.packet_in(ready.s1, 1, frame(FRAMED.encode()), table=2)
    assert [sent.kind for sent in ready.s1.take()] == [ofproto.OFPT_PACKET_OUT]
    assert ready.q1.take() == []


def barriers_of(scene: Scene, hosts: int) -> list[int]:
    """Return the places of barriers among the entries for s1 that filter a number of hosts."""
    scene.s1.take()
    addresses = [f"10.1.{number >> 8}.{number & 255}" for number in range(hosts)]
    scene.quantum.stations = [
        Station(S1, port, MACS[ALICE], address) for port, address in enumerate(addresses, 1)
    ]
    scene.quantum.asked(EventQuestion("reload", {}))
    sent = scene.s1.take()
    assert len(flow_mods(sent)) == 7 * hosts + 2  # seven a host, one for all, and the old ones go
    return [place for place, each in enumerate(sent) if each.kind == ofproto.OFPT_BARRIER_REQUEST]


def test_a_switch_that_is_sent_many_entries_shows_life_between_them(tmp_path: Path) -> None:
    scene = Scene(tmp_path, policy="")
    assert barriers_of(scene, 10) == []
    places = barriers_of(scene, 1000)
    assert len(places) == 70  # 7,002 entries
    assert [later - earlier for earlier, later in pairwise([-1, *places])] == [101] * 70


def test_a_switch_that_answers_a_barrier_owes_no_echo_that_waits_behind_it(scene: Scene) -> None:
    for owed in (scene.s1.unreplied_echo_requests, scene.q1.unreplied_echo_requests):
        owed += [5, 6, 7]
    reply = SimpleNamespace(datapath=scene.s1, xid=99)
    scene.quantum.barrier_passed(SimpleNamespace(msg=reply))
    assert scene.s1.unreplied_echo_requests == []
    assert scene.q1.unreplied_echo_requests == [5, 6, 7]


def test_a_classical_switch_is_there_when_it_has_taken_in_all_entries(scene: Scene) -> None:
    """Before, what hosts say to each other might be dropped by it."""
    sent = scene.s1.take()
    (barrier,) = [each for each in sent if each.kind == ofproto.OFPT_BARRIER_REQUEST]
    assert sent.index(barrier) > max(map(sent.index, flow_mods(sent)))
    here = {"event": "switch", "dpid": S1, "kind": "classical"}
    assert here not in facts(scene)
    answer = SimpleNamespace(msg=SimpleNamespace(datapath=scene.s1, xid=barrier.xid))
    for _again in range(2):
        scene.quantum.barrier_passed(answer)
        assert facts(scene).count(here) == 1


def facts(scene: Scene) -> list[dict[str, Any]]:
    return [{k: v for k, v in fact.items() if k != "time_ns"} for fact in scene.recorded()]
