"""A controller app of one's own, in plain os-ken: three quantum switches swap by themselves.

Its entries go before those of c0. When q1 stores a block of alice's, q1 and q2 make as many pairs:

    qmn run swap --topology chain,fibers=1 --controller os-ken --app examples.repeaters
"""

import struct

from os_ken.base.app_manager import OSKenApp
from os_ken.controller import ofp_event
from os_ken.controller.handler import CONFIG_DISPATCHER, MAIN_DISPATCHER, set_ev_cls

LEFT, RIGHT, NEAR, FAR = 61001, 61002, 62001, 62002  # memories; halves of the source's pairs
SWAP = {LEFT: 60001, RIGHT: 60002, 60001: 1}  # the analyser's outcomes go to s1
PATHS = {
    0x1001: {2: LEFT, NEAR: RIGHT, FAR: 3, **SWAP},
    0x1002: {4: LEFT, NEAR: RIGHT, FAR: 5, **SWAP},
    0x1003: {4: LEFT, 2: RIGHT, **SWAP},
}
SOURCES, HERALDS = (0x1001, 0x1002), 0x88B6  # EtherType
HEAD = struct.Struct("!26xIII")  # of a herald: number of the block, pulses, first of them in it


class Repeaters(OSKenApp):
    """Swaps as soon as possible."""

    OFP_VERSIONS, switches = [0x05], {}

    @set_ev_cls(ofp_event.EventOFPSwitchFeatures, CONFIG_DISPATCHER)
    def switch_connected(self, event):
        """Give a quantum switch its entries."""
        switch = self.switches[event.msg.datapath.id] = event.msg.datapath
        for in_port, out_port in PATHS.get(switch.id, {}).items():
            self.add(switch, 200, out_port, in_port=in_port)
        if switch.id == SOURCES[0]:
            self.add(switch, 201, switch.ofproto.OFPP_CONTROLLER, in_port=LEFT, eth_type=HERALDS)

    def add(self, switch, priority, out_port, **match):
        """Send what comes as `match` says out of a port."""
        parser, apply = switch.ofproto_parser, switch.ofproto.OFPIT_APPLY_ACTIONS
        does = [parser.OFPInstructionActions(apply, [parser.OFPActionOutput(out_port)])]
        entry = {"match": parser.OFPMatch(**match), "instructions": does}
        switch.send_msg(parser.OFPFlowMod(switch, priority=priority, **entry))

    @set_ev_cls(ofp_event.EventOFPPacketIn, MAIN_DISPATCHER)
    def block_stored(self, event):
        """Have sources make pairs for a block of alice's."""
        at, of, frame = event.msg.datapath, event.msg.datapath.ofproto, event.msg.data
        if (at.id, event.msg.match["in_port"]) != (SOURCES[0], LEFT) or HEAD.unpack(frame[:38])[2]:
            return
        for dpid in SOURCES:
            pairs = dpid, *HEAD.unpack(frame[:38])[:2], 50_000_000, 193_400_000  # Hz, MHz
            order = frame[:12] + struct.pack("!H4sQIIII18x", 0x88B5, b"QMNE", *pairs)
            out = [self.switches[dpid].ofproto_parser.OFPActionOutput(NEAR)]
            where = self.switches[dpid], of.OFP_NO_BUFFER, of.OFPP_CONTROLLER
            self.switches[dpid].send_msg(at.ofproto_parser.OFPPacketOut(*where, out, order))
