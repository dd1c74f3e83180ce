"""Two controllers of one quantum switch: roles, and light judged across both."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from agent_scene import (
    DATAPATH,
    Switch,
    accepted,
    bundle,
    entries,
    flow_mod,
    light,
    needs_open_vswitch,
    refused,
    running_switch,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser

pytestmark = needs_open_vswitch
TAKEN = ofp.OFPET_BAD_ACTION, ofp.OFPBAC_BAD_OUT_PORT
SLAVE = ofp.OFPET_BAD_REQUEST, ofp.OFPBRC_IS_SLAVE


@pytest.fixture
def own_switch(tmp_path: Path) -> Iterator[Switch]:
    """A switch of four fibre ports with two controllers."""
    with running_switch(tmp_path, controllers=2) as own_switch:
        yield own_switch


def test_neither_takes_an_output_that_the_other_has(own_switch: Switch) -> None:
    one, other = own_switch.controllers
    for turn in range(20):
        one.send(light(1, 3), 2 * turn + 100)
        one.send(parser.OFPEchoRequest(DATAPATH), 2 * turn + 101)
        one.answer(2 * turn + 101)  # the bridge has it; whether the agent knows is another matter
        assert refused(other, light(2, 3)) == TAKEN
        bundle(other, 50, light(2, 3))
        assert other.answer(51).code == ofp.OFPBAC_BAD_OUT_PORT
        accepted(one, flow_mod(1, command=ofp.OFPFC_DELETE))
    accepted(other, light(2, 3))
    assert own_switch.dispatcher.sets[-1] == [(2, 3)]


def test_both_see_photons_and_timeouts_alike(own_switch: Switch) -> None:
    one, other = own_switch.controllers
    accepted(one, light(1, 3, idle_timeout=30))
    own_switch.dispatcher.passed(7, 1, 3)
    seen = [entries(controller)[0] for controller in (one, other)]
    assert [(entry.packet_count, entry.idle_timeout) for entry in seen] == 2 * [(7, 30)]


def test_new_master_makes_the_old_one_a_slave(own_switch: Switch) -> None:
    one, other = own_switch.controllers
    master = ofp.OFPCR_ROLE_MASTER
    one.send(parser.OFPRoleRequest(DATAPATH, master, 1), 3)
    assert one.answer(3).role == master
    accepted(one, light(1, 3))
    other.send(parser.OFPRoleRequest(DATAPATH, master, 2), 3)
    assert other.answer(3).role == master
    while not isinstance(status := one.next(), parser.OFPRoleStatus):
        pass
    assert (status.role, status.generation_id) == (ofp.OFPCR_ROLE_SLAVE, 2)
    assert refused(one, light(2, 4)) == SLAVE
    accepted(other, light(2, 4))
    one.send(parser.OFPRoleRequest(DATAPATH, master, 1), 4)
    stale = one.answer(4)
    assert (stale.type, stale.code) == (ofp.OFPET_ROLE_REQUEST_FAILED, ofp.OFPRRFC_STALE)
    assert refused(one, light(3, 1)) == SLAVE
    assert own_switch.dispatcher.sets[-1] == [(1, 3), (2, 4)]
