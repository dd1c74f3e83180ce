"""A controller of one's own, in plain Ryu: it opens light paths, and a session runs over them.

s1 forwards by itself, q1 by three flow entries; hosts know that light stands, and ask nobody:

    .venv/bin/python examples/standing_light.py
    sudo PYTHONPATH=. mn --custom topologies/sdc.py --topo sdc,light=standing --controller remote -w
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

Q1, PATHS = 0x1001, {5: 2, 2: 4, 6: 3}  # charlie's ports to alice's and bob's; hers to his


class StandingLight(RyuApp):
    """Opens the paths as soon as q1 connects."""

    OFP_VERSIONS = [0x05]  # noqa: RUF012 (OpenFlow 1.4, as Ryu wants it)

    @set_ev_cls(ofp_event.EventOFPSwitchFeatures, CONFIG_DISPATCHER)
    def switch_connected(self, event):
        """Give a switch its entries."""
        switch = event.msg.datapath
        if switch.id != Q1:
            return self.add(switch, switch.ofproto.OFPP_NORMAL)
        for in_port, out_port in PATHS.items():
            self.add(switch, out_port, in_port=in_port)
        return switch.send_msg(switch.ofproto_parser.OFPBarrierRequest(switch))

    def add(self, switch, out_port, **match):
        """Send what comes as `match` says out of a port."""
        parser, outputs = switch.ofproto_parser, switch.ofproto.OFPIT_APPLY_ACTIONS
        apply = parser.OFPInstructionActions(outputs, [parser.OFPActionOutput(out_port)])
        entry = parser.OFPFlowMod(switch, match=parser.OFPMatch(**match), instructions=[apply])
        return switch.send_msg(entry)

    @set_ev_cls(ofp_event.EventOFPBarrierReply, [CONFIG_DISPATCHER, MAIN_DISPATCHER])
    def light_stands(self, _event):
        """Light passes now: the switch answers a barrier no sooner."""
        print(f"light stands: {PATHS}", flush=True)

    @set_ev_cls(ofp_event.EventOFPErrorMsg, [CONFIG_DISPATCHER, MAIN_DISPATCHER])
    def refused(self, event):
        """Say what a switch would not do."""
        print(f"refused: error type {event.msg.type}, code {event.msg.code}", flush=True)


if __name__ == "__main__":
    manager.main([__file__, *sys.argv[1:]])
