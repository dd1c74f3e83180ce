"""Thousands of spoiled messages to a real bridge with its agent: what stands then was judged."""

import re
from pathlib import Path
from random import Random

import openflow_messages as of
import pytest
from agent_scene import (
    DATAPATH,
    FIBER_PORTS,
    Controller,
    Switch,
    accepted,
    flow_mod,
    flows,
    light,
    needs_open_vswitch,
    outputs,
    refused,
    running_switch,
    wait_until,
)
from mutations import requests, spoiled
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

from qswitch_agent.openflow import matches
from qswitch_agent.openflow.messages import encode

pytestmark = needs_open_vswitch
ROUND = 50  # scenes of messages
FIRST_BARRIER = 0x7A000000
NO_MATCH = (
    *("cookie", "duration", "table", "n_packets", "n_bytes", "idle_timeout", "hard_timeout"),
    *("importance", "priority", "send_flow_rem", "reset_counts", "check_overlap"),
    *("no_packet_counts", "no_byte_counts", "idle_age", "hard_age"),
)


class Entry:
    """A line of `ovs-ofctl dump-flows`."""

    def __init__(self, line: str) -> None:
        head, actions = line.strip().split("actions=")
        fields = dict((*word.split("=", 1), "")[:2] for word in re.split(r"[ ,]+", head) if word)
        self.table = int(fields["table"])
        self.priority = int(fields.get("priority", 0x8000))
        self.match = {name: value for name, value in fields.items() if name not in NO_MATCH}
        self.outputs = [int(port) for port in re.findall(r"output:(\d+)", actions)]
        self.in_port = self.match.get("in_port")

    @property
    def is_light(self) -> bool:
        return self.table == 0 and set(self.match) <= {"in_port"}


def table() -> list[Entry]:
    return [Entry(line) for line in flows("dump-flows").splitlines() if "actions=" in line]


def paths(entries: list[Entry]) -> list[tuple[int, int]]:
    """Return the paths that light meets: the highest priority decides, then the narrower match."""
    found = []
    for port in FIBER_PORTS:
        met = [one for one in entries if one.is_light and one.in_port in (None, str(port))]
        met.sort(key=lambda one: (one.priority, one.in_port is not None))
        if met and met[-1].in_port is not None:
            found += [(port, out_port) for out_port in met[-1].outputs]
    return sorted(found)


def say(controller: Controller, random: Random, barrier: int) -> None:
    """Send a round of messages, each scene with a spoiled one, and wait until they are done."""
    scenes = requests()
    for _scene in range(ROUND):
        scene = random.choice(scenes)
        spoil = random.randrange(len(scene))
        for number, message in enumerate(scene):
            bad = number == spoil
            controller.socket.sendall(spoiled(message, random, 1.0) if bad else message)
    controller.socket.sendall(of.barrier_request(barrier))
    controller.answer(barrier)


def break_the_connection(controller: Controller) -> None:
    """Send a header whose length is less than a header's; the bridge connects again."""
    controller.socket.sendall(bytes.fromhex("0512000700000001"))
    with pytest.raises((AssertionError, ConnectionError)):
        controller.answer(1)
    controller.accept()


@pytest.mark.parametrize("rounds", [15, pytest.param(60, marks=pytest.mark.nightly)])
def test_spoiled_requests_leave_only_what_was_judged(tmp_path: Path, rounds: int) -> None:
    """Two rounds end in a header that ends the connection."""
    random = Random(31415)
    with running_switch(tmp_path) as switch:
        seen = set()
        for number in range(rounds):
            say(switch.controller, random, FIRST_BARRIER + number)
            require_judged(switch)
            seen.update(switch.dispatcher.sets[-1])
            if number in (rounds // 3, 2 * rounds // 3):
                break_the_connection(switch.controller)
        assert len(seen) > 2
        assert switch.agent.poll() is None
        assert "Traceback" not in switch.log.read_text()
        equal = parser.OFPRoleRequest(DATAPATH, ofp.OFPCR_ROLE_EQUAL, 0)
        switch.controller.send(equal, 1)
        accepted(switch.controller, flow_mod(None, command=ofp.OFPFC_DELETE, table_id=0xFF))
        accepted(switch.controller, light(2, 4))
        switch.connects((2, 4))


def require_judged(switch: Switch) -> None:
    """Check that fibres take light from fibres alone, and are connected as the table says."""
    for entry in table():
        if set(entry.outputs) & set(FIBER_PORTS):
            assert entry.is_light
            assert entry.in_port in [str(port) for port in FIBER_PORTS]
            assert len(entry.outputs) == 1
            assert entry.in_port != str(entry.outputs[0])
    wait_until(lambda: switch.dispatcher.sets[-1] == paths(table()), "what the table says")
    assert len({path[1] for path in switch.dispatcher.sets[-1]}) == len(switch.dispatcher.sets[-1])


NOTHING = (
    "80000708" + "020000000000" + "000000000000",  # eth_dst with a mask of zero
    "80000108" + "00000009" + "00000000",  # in_port with a mask of zero
    "80005804" + "00000000",  # packet_type is Ethernet
    "ffff570c" + "4f4e4600" + "00000000" + "00000000",  # actset_output, with a mask of zero
    "00000104" + "0009" + "0000",  # in_port of Nicira, with a mask of zero
)


def test_no_match_modifies_light_in_disguise(switch: Switch) -> None:
    accepted(switch.controller, light(1, 2))
    before = flows("dump-flows", "--no-stats")
    for xid, nothing in enumerate(NOTHING, 90):
        message = of.flow_mod({}, outputs(ofp.OFPP_LOCAL), xid=xid, command=ofp.OFPFC_MODIFY)
        match = matches.join(bytes.fromhex(nothing))
        disguised = encode(message[1], xid, message[8:48] + match + message[56:])
        switch.controller.socket.sendall(disguised + of.barrier_request(1000 + xid))
        while switch.controller.next().xid != 1000 + xid:
            pass
        assert flows("dump-flows", "--no-stats") == before, nothing
    assert refused(switch.controller, light(3, 2))[0] == ofp.OFPET_BAD_ACTION
    switch.connects((1, 2))
