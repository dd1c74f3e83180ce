"""Bundles of light paths: the bytes that the framework of this process makes of its own objects."""

from itertools import count
from types import SimpleNamespace
from typing import Any

import pytest

from controller_apps.light.paths import Hop
from controller_apps.openflow import flow_entries, optical_messages
from controller_apps.openflow.framework import ProtocolDesc, ofproto, parser
from controller_apps.openflow.switches import path_bundle, xid_of
from controller_apps.sessions.actions import OpenPaths
from wire.optical import EXPERIMENTER
from wire.part_descriptions import INNER_PORT

Q1, SESSION, FREQUENCY_MHZ = 2, 0xFEDCBA9876543210, 193_400_000
OPENED = Hop(Q1, 1, 4), Hop(Q1, 0xFFFFFF00, 2)
CLOSED = Hop(Q1, 3, 5), Hop(Q1, 2, 1)


class Datapath(ProtocolDesc):  # type: ignore[misc]
    """A switch with a port that can be tuned."""

    def __init__(self) -> None:
        super().__init__(ofproto.OFP_VERSION)
        self.ports = {7: parser.OFPPort(7, 0, "02:00:00:00:00:07", b"q1-eth7", 0, 0, [])}


def by_the_framework(
    datapath: Any, paths: OpenPaths, tuning: list[Any], first_xid: int
) -> list[bytes]:
    """Return the same bundle from the framework's objects."""
    flags = ofproto.OFPBF_ATOMIC | ofproto.OFPBF_ORDERED
    number = paths.transaction & 0xFFFFFFFF
    members = []
    for hop in paths.closed:
        message = flow_entries.delete(
            datapath, 0, strict=True, priority=100, match=parser.OFPMatch(in_port=hop.in_port)
        )
        message.cookie, message.cookie_mask = paths.session, (1 << 64) - 1
        message.out_port = hop.out_port
        members.append(message)
    members += tuning
    for hop in paths.hops:
        match, out = {"in_port": hop.in_port}, flow_entries.output(hop.out_port)
        members.append(flow_entries.add(datapath, 0, 100, match, out, cookie=paths.session))
    messages = [
        parser.OFPBundleCtrlMsg(datapath, number, ofproto.OFPBCT_OPEN_REQUEST, flags, []),
        *(parser.OFPBundleAddMsg(datapath, number, flags, member, []) for member in members),
        parser.OFPBundleCtrlMsg(datapath, number, ofproto.OFPBCT_COMMIT_REQUEST, flags, []),
        parser.OFPBarrierRequest(datapath),
    ]
    for xid, message in enumerate(messages, first_xid):
        message.set_xid(xid & 0xFFFFFFFF)
        message.serialize()
    return [bytes(message.buf) for message in messages]


class Uncounted:
    """Numbers of ports that cannot be enumerated."""

    __iter__ = None

    def __contains__(self, port: int) -> bool:
        return False


def test_inner_ports_are_looked_up_and_not_enumerated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow_entries, "INNER_PORTS", Uncounted())
    assert flow_entries.inner_frames(Datapath(), OpenPaths(Q1, OPENED, SESSION, 1)) == []


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("transaction", [9, (1 << 32) + 1])
@pytest.mark.parametrize("tuned", [(), (7,)])
@pytest.mark.parametrize("closed", [(), CLOSED])
@pytest.mark.parametrize("opened", [(), OPENED[:1], OPENED])
@pytest.mark.parametrize("first_xid", [1, (1 << 32) - 2])
def test_a_bundle_is_what_the_framework_makes_of_its_objects(
    opened: tuple[Hop, ...],
    closed: tuple[Hop, ...],
    tuned: tuple[int, ...],
    transaction: int,
    first_xid: int,
) -> None:
    datapath = Datapath()
    paths = OpenPaths(Q1, opened, SESSION, transaction, closed, tuned, FREQUENCY_MHZ)

    def tuning() -> list[Any]:
        return [optical_messages.tune(datapath, port, FREQUENCY_MHZ) for port in tuned]

    made = path_bundle(paths, tuning(), count(first_xid))
    assert made == by_the_framework(datapath, paths, tuning(), first_xid)
    xids = [first_xid + number & 0xFFFFFFFF for number in range(len(made))]
    assert [xid_of(message) for message in made] == xids


def test_classical_ports_alone_of_a_quantum_switch_forward_as_any_switch_does() -> None:
    optical = parser.OFPPortDescPropOptical.__new__(parser.OFPPortDescPropOptical)
    own = parser.OFPPortDescPropExperimenter(
        experimenter=EXPERIMENTER, exp_type=INNER_PORT, data=[0, 1]
    )
    datapath: Any = Datapath()
    properties = {1: [optical], 2: [own], 3: [], 4: []}  # a fibre, an inner port, and copper
    datapath.ports = {
        number: SimpleNamespace(port_no=number, properties=each)
        for number, each in properties.items()
    }
    entries = flow_entries.classical_entries(datapath)
    assert sorted(entry.match["in_port"] for entry in entries) == [3, 3, 3, 4, 4, 4]
