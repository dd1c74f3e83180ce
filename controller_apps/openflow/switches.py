"""The connected switches: messages to them, and which of their answers belongs to which request.

The bundle that changes the light paths through a switch, as bytes.

To put it together from the framework's objects took the controller longer than Open vSwitch takes
to read it, while light is waited for.
"""

import struct
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator
from itertools import count
from typing import Any

from controller_apps.light.paths import Hop
from controller_apps.openflow import flow_entries, optical_messages
from controller_apps.openflow.flow_entries import ALL_BITS, LIGHT_TABLE, PATH_PRIORITY
from controller_apps.openflow.framework import Datapath, ofproto
from controller_apps.openflow.mac_table import MacTable, filter_entries
from controller_apps.packets import FiveTuple
from controller_apps.sessions.actions import (
    AddBypass,
    ClosePaths,
    CountBypass,
    Emit,
    Flood,
    Forward,
    KeepPulses,
    OpenPaths,
    RemoveBypass,
    SwitchAction,
)
from wire.analyser_frames import BROADCAST, frames_of
from wire.config import Station

FLAGS = ofproto.OFPBF_ATOMIC | ofproto.OFPBF_ORDERED
HEADER = struct.Struct("!BBHI")  # version, type, length, xid
BUNDLE = struct.Struct("!IHH")  # bundle, type (or padding), flags
# Cookie and its mask; table, command; time-outs; priority, buffer; out_port, out_group; flags;
# importance.
FLOW_MOD = struct.Struct("!QQBBHHHIIIHH")
IN_PORT = struct.Struct("!HHIIxxxx")  # a match: type, length; a field: which, port
OUTPUT = struct.Struct("!HHxxxxHHIHxxxxxx")  # an instruction; an action: type, length, port, bytes
MATCH_LENGTH = IN_PORT.size - 4  # without what fills it up
IN_PORT_FIELD = 0x80000004  # OFPXMC_OPENFLOW_BASIC, OFPXMT_OFB_IN_PORT, no mask, 4 bytes
INSTRUCTION = ofproto.OFPIT_APPLY_ACTIONS, OUTPUT.size
ACTION = ofproto.OFPAT_OUTPUT, 16
XIDS = 0xFFFFFFFF
CONTROLLER = ofproto.OFPP_CONTROLLER


def path_bundle(paths: OpenPaths, others: list[Any], xids: Iterator[int]) -> list[bytes]:
    """Return one bundle that changes the hops through a switch, and a barrier behind it.

    `others` are messages of the framework, such as PORT_MODs. No time-outs: light moves no packets,
    so an entry would expire while in use.
    """
    bundle = paths.transaction & XIDS
    messages = [_control(bundle, ofproto.OFPBCT_OPEN_REQUEST, next(xids))]
    for hop in paths.closed:
        xid = next(xids)
        messages.append(_member(bundle, _delete(hop, paths.session, xid), xid))
    for other in others:
        xid = next(xids)
        other.set_xid(xid & XIDS)
        other.serialize()
        messages.append(_member(bundle, bytes(other.buf), xid))
    for hop in paths.hops:
        xid = next(xids)
        messages.append(_member(bundle, _add(hop, paths.session, xid), xid))
    messages.append(_control(bundle, ofproto.OFPBCT_COMMIT_REQUEST, next(xids)))
    messages.append(_message(ofproto.OFPT_BARRIER_REQUEST, next(xids)))
    return messages


def xid_of(message: bytes) -> int:
    return int.from_bytes(message[4:8], "big")


def _message(kind: int, xid: int, body: bytes = b"") -> bytes:
    return HEADER.pack(ofproto.OFP_VERSION, kind, HEADER.size + len(body), xid & XIDS) + body


def _control(bundle: int, kind: int, xid: int) -> bytes:
    return _message(ofproto.OFPT_BUNDLE_CONTROL, xid, BUNDLE.pack(bundle, kind, FLAGS))


def _member(bundle: int, message: bytes, xid: int) -> bytes:
    head = BUNDLE.pack(bundle, 0, FLAGS)
    return _message(ofproto.OFPT_BUNDLE_ADD_MESSAGE, xid, head + message)


def _add(hop: Hop, session: int, xid: int) -> bytes:
    fixed = _flow_mod(session, 0, ofproto.OFPFC_ADD, 0, 0)
    output = OUTPUT.pack(*INSTRUCTION, *ACTION, hop.out_port, ofproto.OFPCML_NO_BUFFER)
    return _message(ofproto.OFPT_FLOW_MOD, xid, fixed + _match(hop) + output)


def _delete(hop: Hop, session: int, xid: int) -> bytes:
    fixed = _flow_mod(
        session, ALL_BITS, ofproto.OFPFC_DELETE_STRICT, hop.out_port, ofproto.OFPG_ANY
    )
    return _message(ofproto.OFPT_FLOW_MOD, xid, fixed + _match(hop))


def _flow_mod(session: int, mask: int, command: int, out_port: int, out_group: int) -> bytes:
    idle_timeout, hard_timeout, buffer, flags, importance = 0, 0, ofproto.OFP_NO_BUFFER, 0, 0
    return FLOW_MOD.pack(
        *(session, mask, LIGHT_TABLE, command, idle_timeout, hard_timeout, PATH_PRIORITY, buffer),
        *(out_port, out_group, flags, importance),
    )


def _match(hop: Hop) -> bytes:
    return IN_PORT.pack(ofproto.OFPMT_OXM, MATCH_LENGTH, IN_PORT_FIELD, hop.in_port)


Request = tuple[int, int]  # datapath id and xid


class Switches:
    """Sends the arbiter's actions, and keeps the requests that switches have yet to answer."""

    def __init__(
        self,
        quantum: frozenset[int],
        mac_table: MacTable,
        bypass_timeout_s: int,
        trunks: Iterable[tuple[int, int]] = (),
    ) -> None:
        """`quantum` are datapath ids; all other switches are classical.

        Copies of set-up messages go by trunks (datapath id and port) to quantum switches.
        """
        self.quantum = quantum
        self._trunks: defaultdict[int, list[int]] = defaultdict(list)
        for dpid, port in trunks:
            self._trunks[dpid].append(port)
        self.datapaths: dict[int, Datapath] = {}
        self._mac_table, self._bypass_timeout_s = mac_table, bypass_timeout_s
        self._stations: Collection[Station] = ()  # whose addresses are checked
        self._xids = count(1)
        self._transactions: dict[Request, int] = {}  # of the arbiter
        self._listed: dict[Request, list[Any]] = {}  # entries of unfinished replies
        self._counting: dict[Request, FiveTuple] = {}
        self._preparing: dict[Request, str] = {}  # kinds of switches that are being prepared

    def connect(self, datapath: Datapath) -> None:
        """Give a switch its standing entries, and ask for those that sessions left there."""
        self.datapaths[datapath.id] = datapath
        if datapath.id in self.quantum:
            datapath.send_msg(flow_entries.discovery_entry(datapath))
            trunks = self._trunks[datapath.id]
            copied = flow_entries.copy_entries(datapath, trunks)
            for message in [*copied, *flow_entries.classical_entries(datapath)]:
                datapath.send_msg(message)
            self._ask_entries(datapath, flow_entries.LIGHT_TABLE)
            return
        self._filter(datapath)
        for message in flow_entries.metadata_entries(datapath, self._trunks[datapath.id]):
            datapath.send_msg(message)
        self._ask_entries(datapath, flow_entries.METADATA_TABLE)
        barrier = flow_entries.barrier(datapath)
        datapath.send_msg(barrier)
        self._preparing[datapath.id, barrier.xid] = "classical"

    def disconnect(self, dpid: int) -> None:
        del self.datapaths[dpid]
        requests: tuple[dict[Request, Any], ...] = (
            self._transactions,
            self._listed,
            self._counting,
            self._preparing,
        )
        for table in requests:
            for key in [key for key in table if key[0] == dpid]:
                del table[key]

    def check_addresses(self, stations: Collection[Station]) -> None:
        """Let classical switches drop frames that do not bear their station's addresses."""
        self._stations = stations
        for dpid, datapath in self.datapaths.items():
            if dpid not in self.quantum:
                self._filter(datapath)

    def _filter(self, datapath: Datapath) -> None:
        entries = filter_entries(datapath, self._stations)
        flow_entries.send(datapath, flow_entries.with_barriers(datapath, entries))

    def _ask_entries(self, datapath: Datapath, table: int) -> None:
        question = flow_entries.ask_entries(datapath, table)
        datapath.send_msg(question)
        self._listed[datapath.id, question.xid] = []

    def listed(self, reply: Any) -> list[Any] | None:
        """Return all entries of a table once the last part has come; None before, or unasked."""
        request = reply.datapath.id, reply.xid
        if request not in self._listed:
            return None
        self._listed[request] += reply.body
        if reply.flags & ofproto.OFPMPF_REPLY_MORE:
            return None
        return self._listed.pop(request)

    def counted(self, reply: Any) -> tuple[FiveTuple, int] | None:
        """Return a connection and its bytes if this is the answer to a CountBypass."""
        five_tuple = self._counting.pop((reply.datapath.id, reply.xid), None)
        if five_tuple is None:
            return None
        return five_tuple, sum(entry.byte_count for entry in reply.body)

    def prepared(self, dpid: int, xid: int) -> str | None:
        return self._preparing.pop((dpid, xid), None)

    def transaction_of(self, dpid: int, xid: int) -> int | None:
        return self._transactions.get((dpid, xid))

    def end_transaction(self, dpid: int, xid: int) -> int | None:
        """Return the arbiter's transaction of a barrier, whose bundle is done."""
        transaction = self._transactions.get((dpid, xid))
        if transaction is None:
            return None
        while self._transactions.get((dpid, xid)) == transaction:
            del self._transactions[dpid, xid]
            xid -= 1
        return transaction

    def delete_entry(self, datapath: Datapath, entry: Any) -> None:
        table = flow_entries.METADATA_TABLE
        datapath.send_msg(flow_entries.delete_entry(datapath, table, entry))

    def send(self, action: SwitchAction) -> None:
        """Do what the arbiter decided; a switch that is gone needs nothing."""
        datapath = self.datapaths.get(action.dpid)
        if datapath is not None:
            flow_entries.send(datapath, self._messages(datapath, action))

    def _messages(self, datapath: Datapath, action: SwitchAction) -> list[Any]:
        match action:
            case Forward(dpid, in_port, frame):
                port = self._mac_table.port_of(dpid, frame[:6])
                return [flow_entries.packet_out(datapath, in_port, port, frame)]
            case Flood(_, frame):
                return [flow_entries.packet_out(datapath, CONTROLLER, ofproto.OFPP_FLOOD, frame)]
            case OpenPaths():
                return self._path_messages(datapath, action)
            case Emit(_, port, emission):
                return [flow_entries.packet_out(datapath, CONTROLLER, port, emission.encode())]
            case KeepPulses(_, port, herald):
                frames = [frame.encode(BROADCAST, bytes(6)) for frame in frames_of(herald)]
                return [
                    flow_entries.packet_out(datapath, CONTROLLER, port, each) for each in frames
                ]
            case ClosePaths(_, session):
                return [flow_entries.delete_paths(datapath, session)]
            case AddBypass(_, five_tuple, session):
                timeout_s = self._bypass_timeout_s
                return [flow_entries.bypass(datapath, five_tuple, session, timeout_s)]
            case RemoveBypass(_, five_tuple, session):
                return [flow_entries.delete_bypass(datapath, five_tuple, session)]
            case CountBypass(dpid, five_tuple, session):
                question = flow_entries.count_bypass(datapath, five_tuple, session)
                datapath.set_xid(question)
                self._counting[dpid, question.xid] = five_tuple
                return [question]

    def _path_messages(self, datapath: Datapath, action: OpenPaths) -> list[bytes]:
        ports = [port for port in action.tuned if port in datapath.ports]
        tuning = [optical_messages.tune(datapath, port, action.frequency_mhz) for port in ports]
        frames = flow_entries.inner_frames(datapath, action)
        messages = path_bundle(action, [*tuning, *frames], self._xids)
        for message in messages:
            self._transactions[action.dpid, xid_of(message)] = action.transaction
        return messages
