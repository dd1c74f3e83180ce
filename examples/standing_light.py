"""A controller of one's own, in plain Ryu: it opens light paths, and a session runs over them.

Nothing here knows of quantum metadata: s1 forwards by itself, and on q1 three ordinary flow
entries send light from charlie (ports 5 and 6) to alice (2) and bob (3), and alice's to bob (4).
The hosts are told that light stands, so they ask no controller for it:

    .venv/bin/python examples/standing_light.py
    sudo PYTHONPATH=. mn --custom topologies/sdc.py --topo sdc,light=standing --controller remote
    mininet> bob python -m hosts.applications.receive --background --output /tmp/got 7
    mininet> alice echo hello | python -m hosts.applications.send bob 7
    mininet> bob cat /tmp/got
"""

import sys

import eventlet.wsgi

eventlet.wsgi.ALREADY_HANDLED = object()  # Ryu 4.34 imports it; newer eventlet has it no more

from ryu.base.app_manager import RyuApp  # noqa: E402
from ryu.cmd import manager  # noqa: E402
from ryu.controller import ofp_event  # noqa: E402
from ryu.controller.handler import CONFIG_DISPATCHER, MAIN_DISPATCHER, set_ev_cls  # noqa: E402
from ryu.ofproto import ofproto_v1_4  # noqa: E402

Q1 = 0x1001
PATHS = {5: 2, 2: 4, 6: 3}  # in_port: out_port


class StandingLight(RyuApp):
    """Opens the paths as soon as q1 connects."""

    OFP_VERSIONS = [ofproto_v1_4.OFP_VERSION]  # noqa: RUF012 (as Ryu wants it)

    @set_ev_cls(ofp_event.EventOFPSwitchFeatures, CONFIG_DISPATCHER)
    def switch_connected(self, event):
        """Give a switch its entries."""
        switch = event.msg.datapath
        if switch.id != Q1:
            self.add(switch, {}, switch.ofproto.OFPP_NORMAL)
            return
        for in_port, out_port in PATHS.items():
            self.add(switch, {"in_port": in_port}, out_port)
        switch.send_msg(switch.ofproto_parser.OFPBarrierRequest(switch))

    def add(self, switch, match, out_port):
        """Send what comes as `match` says out of a port."""
        parser = switch.ofproto_parser
        output = parser.OFPActionOutput(out_port)
        apply = parser.OFPInstructionActions(switch.ofproto.OFPIT_APPLY_ACTIONS, [output])
        match = parser.OFPMatch(**match)
        switch.send_msg(parser.OFPFlowMod(switch, match=match, instructions=[apply]))

    @set_ev_cls(ofp_event.EventOFPBarrierReply, [CONFIG_DISPATCHER, MAIN_DISPATCHER])
    def light_stands(self, _event):
        """Light passes now: the switch answers a barrier no sooner."""
        print(f"light stands: {PATHS}", flush=True)

    @set_ev_cls(ofp_event.EventOFPErrorMsg, [CONFIG_DISPATCHER, MAIN_DISPATCHER])
    def refused(self, event):
        """Say what a switch would not do."""
        print(f"refused: error type {event.msg.type}, code {event.msg.code}", flush=True)


if __name__ == "__main__":
    sys.argv[0] = "ryu-manager"
    manager.main([__file__, *sys.argv[1:]])
