"""The OpenFlow messages of both apps: standing entries, paths, bypasses, packets out.

Classical switches: table 0 filters (openflow.stations), table 1 picks quantum metadata out, table 2
learns and forwards, table 3 copies set-up messages for quantum switches.
Quantum switches: table 0 holds light paths and nothing else, but for LLDP.
"""

from collections.abc import Collection, Iterable, Set
from typing import Any

from controller_apps.light.paths import Hop
from controller_apps.openflow.framework import Datapath, ofproto, parser
from controller_apps.openflow.optical_messages import is_fiber, is_inner
from controller_apps.packets import ACK, FIN, IP_TCP, IP_UDP, PSH, RST, SYN, FiveTuple, is_udp
from controller_apps.sessions.actions import OpenPaths
from wire.analyser_frames import ETHER_TYPE, HERALDS, Receivers, address_of_place, group_of
from wire.device import DEVICE_PORT
from wire.metadata.header import METADATA_PORT, QUANTUM_SWITCHES
from wire.parameters.switch import INNER_PORTS, Kind, inner_port, memory_of

FILTER_TABLE, METADATA_TABLE, LEARNING_TABLE, COPY_TABLE = 0, 1, 2, 3
COPY_METER, COPIES_PER_S, MOST_COPIES = 1, 200, 2000  # more set-ups than c0 grants, and at once
LIGHT_TABLE = 0
TRUNK_PRIORITY, HIDDEN_PRIORITY = 510, 500
CLOSE_PRIORITY, BYPASS_PRIORITY, OPENING_PRIORITY = 400, 300, 250
METADATA_PRIORITY = 200
PATH_PRIORITY = 100
LLDP_PRIORITY = 65000
LEARNING_PRIORITY = 1
ENTRIES_PER_BARRIER = 100
ETH_TYPE_IPV4, ETH_TYPE_LLDP = 0x0800, 0x88CC
ETH_TYPE_OUTCOMES, ETH_TYPE_HERALDS = (int.from_bytes(kind) for kind in (ETHER_TYPE, HERALDS))
ANY_GROUP = b"\xff" + bytes(5)  # mask of the groups of all sessions
VLAN_TAGS = 0x8100, 0x88A8  # IEEE 802.1Q, of customers and of services
ALL_BITS = (1 << 64) - 1
TO_METADATA_PORT = {"eth_type": ETH_TYPE_IPV4, "ip_proto": IP_TCP, "tcp_dst": METADATA_PORT}


def is_picked_datagram(message: Any, quantum_switches: Set[int]) -> bool:
    classical = message.datapath.id not in quantum_switches
    return classical and message.table_id == METADATA_TABLE and is_udp(message.data)


def output(*ports: int) -> Any:
    return _apply(_outputs(ports))


def _outputs(ports: Iterable[int]) -> list[Any]:
    return [parser.OFPActionOutput(port, ofproto.OFPCML_NO_BUFFER) for port in ports]


def _apply(actions: list[Any]) -> Any:
    return parser.OFPInstructionActions(ofproto.OFPIT_APPLY_ACTIONS, actions)


def to_controller(*ports: int) -> Any:
    return output(ofproto.OFPP_CONTROLLER, *ports)


def to_learning() -> Any:
    return parser.OFPInstructionGotoTable(LEARNING_TABLE)


def add(
    datapath: Datapath,
    table: int,
    priority: int,
    match: dict[str, Any],
    *instructions: Any,
    **more: Any,
) -> Any:
    return parser.OFPFlowMod(
        datapath,
        table_id=table,
        priority=priority,
        match=parser.OFPMatch(**match),
        instructions=list(instructions),
        **more,
    )


def delete(datapath: Datapath, table: int, strict: bool = False, **more: Any) -> Any:
    command = ofproto.OFPFC_DELETE_STRICT if strict else ofproto.OFPFC_DELETE
    return parser.OFPFlowMod(
        datapath,
        table_id=table,
        command=command,
        out_port=ofproto.OFPP_ANY,
        out_group=ofproto.OFPG_ANY,
        **more,
    )


def metadata_entries(datapath: Datapath, trunks: Collection[int] = ()) -> list[Any]:
    """Return what makes a table of a classical switch pick quantum metadata out.

    Segments that are pushed, as set-up messages are, are copied to the quantum switches by
    way of the trunks, ports that lead to switches: in a table of their own, as Open vSwitch
    would else tell all TCP by that flag, and exchange a connection's first segments.

    Bypasses, which carry the cookie of their session, stay: see ask_entries.
    Whatever can carry a set-up message goes to the controller, whichever flags it has: a switch
    cannot see whether a segment has data. The first SYN stays in the switch; what else might be
    in it no listener takes. Packets that a switch cannot read go no further.
    """
    to_port = TO_METADATA_PORT
    to_agents = {"eth_type": ETH_TYPE_IPV4, "ip_proto": IP_UDP, "udp_dst": DEVICE_PORT}
    groups = tuple(each.hex(":") for each in (group_of(0, Receivers.CONTROLLER), ANY_GROUP))
    of_ends = {"eth_type": ETH_TYPE_HERALDS, "eth_dst": groups}
    opening = {**to_port, "tcp_flags": (SYN, SYN | ACK | FIN | RST)}
    return [
        delete(datapath, METADATA_TABLE, cookie=0, cookie_mask=ALL_BITS),
        delete(datapath, COPY_TABLE),
        add(datapath, METADATA_TABLE, 0, {}, to_learning()),
        add(datapath, METADATA_TABLE, OPENING_PRIORITY, opening, to_learning()),
        add(
            datapath,
            METADATA_TABLE,
            METADATA_PRIORITY,
            to_port,
            to_controller(),
            parser.OFPInstructionGotoTable(COPY_TABLE),
        ),
        # Of the node agents, and of ends that purify: to the controller and to nobody else.
        add(datapath, METADATA_TABLE, METADATA_PRIORITY, to_agents, to_controller()),
        add(datapath, METADATA_TABLE, METADATA_PRIORITY, of_ends, to_controller()),
        *_copies_for_controller(datapath),
        *(add(datapath, METADATA_TABLE, HIDDEN_PRIORITY, hidden) for hidden in unseen()),
        *_copies_for_switches(datapath, trunks),
    ]


def _copies_for_controller(datapath: Datapath) -> list[Any]:
    """Return what copies answers and closes, neither of which must wait for the controller."""
    to_port = TO_METADATA_PORT
    from_port = {"eth_type": ETH_TYPE_IPV4, "ip_proto": IP_TCP, "tcp_src": METADATA_PORT}
    copied = [(to_port, FIN), (to_port, RST), (from_port, RST), (from_port, SYN | ACK)]
    return [
        add(datapath, METADATA_TABLE, CLOSE_PRIORITY, {**ends, "tcp_flags": (flags, flags)},
            to_controller(), to_learning())
        for ends, flags in copied
    ]  # fmt: skip


def _copies_for_switches(datapath: Datapath, trunks: Collection[int]) -> list[Any]:
    """Return what sends copies to all quantum switches; hosts send none.

    A meter drops what is more than all sessions need, so that a host that floods does not fill q1.
    """
    to_group = {"eth_dst": QUANTUM_SWITCHES}
    entries = [add(datapath, METADATA_TABLE, HIDDEN_PRIORITY, to_group)]
    if trunks:
        pushed = {**TO_METADATA_PORT, "tcp_flags": (PSH, PSH)}
        metered = parser.OFPInstructionMeter(COPY_METER)
        copied = _apply([parser.OFPActionSetField(eth_dst=QUANTUM_SWITCHES), *_outputs(trunks)])
        entries += _meter(datapath)
        entries.append(add(datapath, COPY_TABLE, METADATA_PRIORITY, pushed, metered, copied))
    for port in trunks:
        match, onward = {"in_port": port, **to_group}, output(*_others(trunks, port))
        entries.append(add(datapath, METADATA_TABLE, TRUNK_PRIORITY, match, onward))
    return entries


def _meter(datapath: Datapath) -> list[Any]:
    """Return what makes the meter of copies; an earlier controller may have left one."""
    band = parser.OFPMeterBandDrop(rate=COPIES_PER_S, burst_size=MOST_COPIES)
    flags = ofproto.OFPMF_PKTPS | ofproto.OFPMF_BURST
    return [
        parser.OFPMeterMod(datapath, ofproto.OFPMC_DELETE, flags, COPY_METER),
        parser.OFPMeterMod(datapath, ofproto.OFPMC_ADD, flags, COPY_METER, [band]),
    ]


def unseen() -> list[dict[str, Any]]:
    """Return matches of frames in which a switch does not see what the receiver's kernel does.

    A switch looks behind one VLAN tag; Linux takes off as many as have the number 0. A switch
    gives pieces of an IP packet port 0; Linux puts them together.
    """
    tagged_again = [{"eth_type": tag} for tag in VLAN_TAGS]
    piece_of_tcp = {"eth_type": ETH_TYPE_IPV4, "ip_proto": IP_TCP, "tcp_src": 0, "tcp_dst": 0}
    return [*tagged_again, piece_of_tcp]


def discovery_entry(datapath: Datapath) -> Any:
    """Return what the fibres of a quantum switch need: LLDP goes up, all else is dark."""
    return add(datapath, 0, LLDP_PRIORITY, {"eth_type": ETH_TYPE_LLDP}, to_controller())


def classical_entries(datapath: Datapath) -> list[Any]:
    """Return what lets the classical ports of a quantum switch forward as any switch does."""
    ports = list(datapath.ports.values())
    if not any(map(is_fiber, ports)):  # nothing tells which are fibres
        return []
    classical = [port.port_no for port in ports if not (is_fiber(port) or is_inner(port))]
    learned = [
        add(datapath, 0, LEARNING_PRIORITY, {"in_port": port}, to_learning()) for port in classical
    ]
    passed = [  # of other switches, without a question to the controller
        add(
            datapath,
            0,
            LEARNING_PRIORITY + 1,
            {"in_port": port, "eth_type": kind},
            output(*_others(classical, port)),
        )
        for port in classical
        for kind in (ETH_TYPE_OUTCOMES, ETH_TYPE_HERALDS)
    ]
    return [*learned, *passed]


def inner_frames(datapath: Datapath, opened: OpenPaths) -> list[Any]:
    """Return what sends frames of inner ports to a session's hosts, and heralds up."""
    session, heard = opened.session, opened.heard
    entries = []
    lit = {hop.out_port for hop in opened.hops} | {memory_of(hop.in_port) for hop in opened.hops}
    for port in sorted(port for port in lit if port in INNER_PORTS):
        outcomes = _to_hosts(session, Receivers.BOTH, opened.reports, opened.place)
        kinds = {ETH_TYPE_OUTCOMES: outcomes}
        if inner_port(port).kind == Kind.MEMORY or not opened.place:
            kinds[ETH_TYPE_HERALDS] = (
                _to_hosts(session, heard[port]) if port in heard else to_controller()
            )
        entries += [
            add(
                datapath,
                LIGHT_TABLE,
                METADATA_PRIORITY,
                {"in_port": port, "eth_type": kind},
                instruction,
                cookie=session,
            )
            for kind, instruction in kinds.items()
        ]
    return entries


def _to_hosts(session: int, to: Receivers, reports: bool = True, place: int = 0) -> Any:
    """Return the instruction that sends a frame to hosts of a session, and reports also up."""
    fields = {"eth_dst": group_of(session, to)}
    if place:
        fields["eth_src"] = address_of_place(place)
    ports = [ofproto.OFPP_FLOOD, *[ofproto.OFPP_CONTROLLER] * reports]
    named = [parser.OFPActionSetField(**{name: each.hex(":")}) for name, each in fields.items()]
    return _apply([*named, *_outputs(ports)])


def copy_entries(datapath: Datapath, trunks: Collection[int]) -> list[Any]:
    """Return what counts copies of set-up messages at a quantum switch, and hands them up.

    They go on by all its other trunks.
    """
    return [
        add(
            datapath,
            LIGHT_TABLE,
            METADATA_PRIORITY,
            {"in_port": port, "eth_dst": QUANTUM_SWITCHES, **TO_METADATA_PORT},
            to_controller(*_others(trunks, port)),
        )
        for port in trunks
    ]


def _others(ports: Collection[int], port: int) -> list[int]:
    return [other for other in ports if other != port]


def ask_entries(datapath: Datapath, table: int) -> Any:
    return parser.OFPFlowStatsRequest(
        datapath, 0, table, ofproto.OFPP_ANY, ofproto.OFPG_ANY, 0, 0, parser.OFPMatch()
    )


def delete_paths(datapath: Datapath, session: int) -> Any:
    return delete(datapath, 0, cookie=session, cookie_mask=ALL_BITS)


def is_path(entry: Any) -> bool:
    """Tell whether flow statistics describe an entry that a path has (path_bundles)."""
    return bool(entry.cookie and entry.priority == PATH_PRIORITY)


def hop_of(dpid: int, entry: Any) -> Hop | None:
    """Read back the hop of such an entry, None if somebody has made it something else."""
    outputs = [
        action.port
        for instruction in entry.instructions
        for action in getattr(instruction, "actions", ())
        if isinstance(action, parser.OFPActionOutput)
    ]
    in_port = dict(entry.match.items()).get("in_port")
    return Hop(dpid, in_port, outputs[0]) if in_port is not None and outputs else None


def _connection(five_tuple: FiveTuple) -> dict[str, Any]:
    return {
        "eth_type": ETH_TYPE_IPV4,
        "ip_proto": IP_TCP,
        "ipv4_src": five_tuple.source,
        "ipv4_dst": five_tuple.destination,
        "tcp_src": five_tuple.source_port,
        "tcp_dst": five_tuple.destination_port,
    }


BYPASS_FIELDS = set(_connection(FiveTuple("", 0, "", 0)))


def bypass(datapath: Datapath, five_tuple: FiveTuple, session: int, idle_timeout_s: int) -> Any:
    """Return the entry that lets a connection pass without the controller."""
    return add(
        datapath,
        METADATA_TABLE,
        BYPASS_PRIORITY,
        _connection(five_tuple),
        to_learning(),
        cookie=session,
        idle_timeout=idle_timeout_s,
        flags=ofproto.OFPFF_SEND_FLOW_REM,
    )


def delete_bypass(datapath: Datapath, five_tuple: FiveTuple, session: int) -> Any:
    return delete(
        datapath,
        METADATA_TABLE,
        strict=True,
        priority=BYPASS_PRIORITY,
        match=parser.OFPMatch(**_connection(five_tuple)),
        cookie=session,
        cookie_mask=ALL_BITS,
    )


def count_bypass(datapath: Datapath, five_tuple: FiveTuple, session: int) -> Any:
    match = parser.OFPMatch(**_connection(five_tuple))
    return parser.OFPFlowStatsRequest(
        datapath, 0, METADATA_TABLE, ofproto.OFPP_ANY, ofproto.OFPG_ANY, session, ALL_BITS, match
    )


def five_tuple_of(match: Any) -> FiveTuple:
    return FiveTuple(match["ipv4_src"], match["tcp_src"], match["ipv4_dst"], match["tcp_dst"])


def bypassed(entry: Any) -> FiveTuple | None:
    """Read back which connection a bypass lets pass, None if an entry is not a bypass."""
    fields = dict(entry.match.items())
    if entry.priority != BYPASS_PRIORITY or fields.keys() != BYPASS_FIELDS:
        return None
    return five_tuple_of(fields)


def delete_entry(datapath: Datapath, table: int, entry: Any) -> Any:
    """Return the message that deletes one entry, as flow statistics describe it."""
    return delete(
        datapath,
        table,
        strict=True,
        priority=entry.priority,
        match=entry.match,
        cookie=entry.cookie,
        cookie_mask=ALL_BITS,
    )


def packet_out(datapath: Datapath, in_port: int, port: int | None, frame: bytes) -> Any:
    """Return the message that sends a frame out of a port, or of all others if it is None."""
    action = parser.OFPActionOutput(ofproto.OFPP_FLOOD if port is None else port)
    return parser.OFPPacketOut(
        datapath, buffer_id=ofproto.OFP_NO_BUFFER, in_port=in_port, actions=[action], data=frame
    )


def barrier(datapath: Datapath) -> Any:
    """Return the request that a switch answers when it has done all that it was sent before."""
    return parser.OFPBarrierRequest(datapath)


def with_barriers(datapath: Datapath, entries: list[Any]) -> list[Any]:
    """Return entries with a barrier after each hundred, by whose replies a switch shows life.

    Open vSwitch takes thousands of entries for some time, and what is sent behind them, as echoes,
    waits so long for its answer.
    """
    messages = []
    for number, entry in enumerate(entries, 1):
        messages.append(entry)
        if number % ENTRIES_PER_BARRIER == 0:
            messages.append(barrier(datapath))
    return messages


def send(datapath: Datapath, messages: list[Any]) -> None:
    """Send messages, of the framework or as bytes, in one write, so that a bundle is one packet."""
    data = bytearray()
    for message in messages:
        if isinstance(message, bytes):
            data += message
            continue
        if message.xid is None:
            datapath.set_xid(message)
        message.serialize()
        data += message.buf
    datapath.send(data)
