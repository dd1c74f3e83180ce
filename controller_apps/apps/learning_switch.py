"""MAC learning on every switch; at a quantum switch between its classical ports alone.

Like the frameworks' simple_switch_14, in a table of its own, with entries that expire.
"""

from typing import Any

from controller_apps.openflow import flow_entries
from controller_apps.openflow.flow_entries import LEARNING_TABLE
from controller_apps.openflow.framework import (
    DEAD,
    MAIN,
    App,
    Datapath,
    ofp_event,
    ofproto,
    on,
    parser,
)
from controller_apps.openflow.mac_table import MacTable
from controller_apps.timeouts import STATION_TIMEOUT_S
from wire.config import ControllerConfig

LINK_LOCAL = bytes.fromhex("0180c20000")  # and one byte below 0x10: never forwarded (802.1D)


class LearningSwitch(App):
    """Learns where stations are and lets the switch forward what it knows."""

    OFP_VERSIONS = (ofproto.OFP_VERSION,)

    def __init__(self, config: ControllerConfig, mac_table: MacTable, **contexts: Any) -> None:
        super().__init__(**contexts)
        self.time = config.time
        self.mac_table = mac_table

    @on(ofp_event.EventOFPStateChange, MAIN, DEAD)
    def switch_changed(self, event: Any) -> None:
        datapath = event.datapath
        if datapath.id is None:
            return
        self.mac_table.forget(datapath.id)
        if event.state == MAIN:
            datapath.send_msg(flow_entries.delete(datapath, LEARNING_TABLE))
            miss = flow_entries.to_controller()
            datapath.send_msg(flow_entries.add(datapath, LEARNING_TABLE, 0, {}, miss))

    def takes(self, message: Any) -> bool:
        return bool(message.table_id == LEARNING_TABLE)

    @on(ofp_event.EventOFPPacketIn, MAIN)
    def packet_arrived(self, event: Any) -> None:
        message = event.msg
        if not self.takes(message):
            return
        datapath, frame, in_port = message.datapath, bytes(message.data), message.match["in_port"]
        destination, source = frame[:6], frame[6:12]
        if len(source) < 6 or (destination[:5] == LINK_LOCAL and destination[5] < 0x10):
            return
        if self.mac_table.learn(datapath.id, source, in_port):
            moved = parser.OFPMatch(eth_dst=text(source))
            datapath.send_msg(flow_entries.delete(datapath, LEARNING_TABLE, match=moved))
        port = self.mac_table.port_of(datapath.id, destination)
        if port is not None:
            self._remember(datapath, in_port, source, destination, port)
        else:
            port = self.mac_table.asked_at(datapath.id, in_port, frame)
        datapath.send_msg(flow_entries.packet_out(datapath, in_port, port, frame))

    def _remember(
        self, datapath: Datapath, in_port: int, source: bytes, destination: bytes, port: int
    ) -> None:
        # The source too, so that a second station behind the same port is learned as well.
        match = {"in_port": in_port, "eth_src": text(source), "eth_dst": text(destination)}
        entry = flow_entries.add(
            datapath,
            LEARNING_TABLE,
            1,
            match,
            flow_entries.output(port),
            idle_timeout=self.time.switch_timeout_s(STATION_TIMEOUT_S),
        )
        datapath.send_msg(entry)


def text(station: bytes) -> str:
    return station.hex(":")
