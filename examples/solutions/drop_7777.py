"""Exercise 2: a Ryu app that drops UDP to port 7777 at switches of copper."""

from typing import Any

from ryu.base.app_manager import RyuApp
from ryu.controller import ofp_event
from ryu.controller.handler import MAIN_DISPATCHER, set_ev_cls
from ryu.ofproto import ofproto_v1_4

FIRST_QUANTUM = 0x1000  # datapath ids of quantum switches begin here


class DropPort(RyuApp):
    OFP_VERSIONS = [ofproto_v1_4.OFP_VERSION]  # noqa: RUF012 (as Ryu has it)

    @set_ev_cls(ofp_event.EventOFPStateChange, MAIN_DISPATCHER)
    def join(self, event: Any) -> None:
        """Add the entry when a switch has joined."""
        datapath = event.datapath
        if datapath.id >= FIRST_QUANTUM:
            return
        parser = datapath.ofproto_parser
        match = parser.OFPMatch(eth_type=0x0800, ip_proto=17, udp_dst=7777)
        datapath.send_msg(
            parser.OFPFlowMod(
                datapath, cookie=0xC0FFEE, priority=60_000, match=match, instructions=[]
            )
        )
