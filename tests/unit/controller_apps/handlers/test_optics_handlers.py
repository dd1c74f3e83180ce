"""Optics that switches tell, and the tuning of ports."""

import struct
from dataclasses import replace
from types import SimpleNamespace

import handlers_scene
from handlers_scene import BAND, Datapath, Scene, asked_optics, fiber_port, reconnect
from metadata_scene import (
    FIBERS,
    FRAMED,
    Q1,
    frame,
)

from controller_apps.openflow import framework
from controller_apps.openflow.framework import ofproto, parser
from wire.optical import (
    ALL_VALID,
    ANY_PORT,
    RX_TUNE,
    TX_TUNE,
    USE_FREQ,
    PathOptics,
    PortLight,
    PortTuning,
)

LIGHT = PortLight(ALL_VALID, 193_500_000, 0, 0, 193_500_000, 0, 0, -30, -42, 500, 250)

scene = handlers_scene.scene  # fixtures


def test_ports_tell_how_they_can_be_tuned_and_what_they_measure(scene: Scene) -> None:
    q1 = reconnect(scene, fiber_port(6))
    optics = scene.quantum.network.optics
    assert optics.ranges == {(Q1, 6): BAND}
    scene.measure(q1, 6, LIGHT)
    assert optics.lights == {(Q1, 6): LIGHT}
    assert optics.tuned_mhz == {(Q1, 6): 193_500_000}


def test_optics_that_come_in_parts_are_taken_whole(scene: Scene) -> None:
    scene.connect(scene.q1, framework.DEAD)
    q1 = scene.q1 = Datapath(Q1)
    scene.connect(q1)
    one, two, others = (
        PathOptics(1, 2, 5, 1),
        PathOptics(2, 1, 6, 2),
        PathOptics(ANY_PORT, ANY_PORT, 7, 3),
    )
    scene.tell_optics(q1, one, two, more=True)
    assert Q1 not in scene.quantum.network.connected
    scene.tell_optics(q1, others)
    assert Q1 in scene.quantum.network.connected
    report = scene.quantum.network.optics.path
    assert [report(Q1, 1, 2), report(Q1, 2, 1), report(Q1, 3, 4)] == [one, two, others]


def test_a_switch_that_knows_nothing_of_optics_is_of_use_all_the_same(scene: Scene) -> None:
    scene.connect(scene.q1, framework.DEAD)
    q1 = scene.q1 = Datapath(Q1)
    scene.connect(q1)
    assert Q1 not in scene.quantum.network.connected
    error = parser.OFPErrorMsg(q1, ofproto.OFPET_BAD_REQUEST, ofproto.OFPBRC_BAD_EXPERIMENTER, b"")
    error.xid = asked_optics(q1)
    scene.quantum.switch_refused(SimpleNamespace(msg=error))
    assert Q1 in scene.quantum.network.connected


def test_ports_are_tuned_first_in_the_bundle(scene: Scene) -> None:
    q1 = reconnect(scene, *(fiber_port(number) for number in FIBERS))
    scene.announce()
    for number in (2, 3, 4, 5):
        scene.measure(q1, number, replace(LIGHT, tx_mhz=193_400_000, rx_mhz=193_400_000))
    scene.measure(q1, 1, LIGHT)
    scene.packet_in(scene.s1, 1, frame(FRAMED.encode()))
    _opening, tuning, *adds, _commit, _barrier = q1.take()
    assert len(adds) == 3
    message = tuning.inner
    assert message.kind == ofproto.OFPT_PORT_MOD
    assert struct.unpack_from("!I4x6s", message.data, 8) == (1, bytes([2, 0, 0, 0, 9, 1]))
    assert PortTuning.decode(message.data[32:]) == PortTuning(
        RX_TUNE | TX_TUNE | USE_FREQ, 193_400_000, 0, 0, 0
    )
