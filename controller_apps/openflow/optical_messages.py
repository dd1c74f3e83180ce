"""OpenFlow's optical properties and our experimenter message, by the framework's classes."""

from typing import Any

from controller_apps.openflow.framework import Datapath, ofproto, parser
from wire.optical import (
    EXPERIMENTER,
    PATH_OPTICS,
    RX_TUNE,
    TX_TUNE,
    USE_FREQ,
    PortLight,
    PortOptics,
)
from wire.parameters.switch import Kind

MODES = 2  # behind kind, half and number, by 32 bits (wire/part_descriptions.py)


def ask_paths(datapath: Datapath) -> Any:
    return parser.OFPExperimenterStatsRequest(datapath, 0, EXPERIMENTER, PATH_OPTICS, b"")


def ask_ports(datapath: Datapath) -> Any:
    return parser.OFPPortStatsRequest(datapath, 0, ofproto.OFPP_ANY)


def tune(datapath: Datapath, port: int, frequency_mhz: int) -> Any:
    """Return the message that tunes a port, in both directions."""
    optical = parser.OFPPortModPropOptical(
        type_=ofproto.OFPPMPT_OPTICAL,
        configure=RX_TUNE | TX_TUNE | USE_FREQ,
        freq_lmda=frequency_mhz,
        fl_offset=0,
        grid_span=0,
        tx_pwr=0,
    )
    address = datapath.ports[port].hw_addr
    return parser.OFPPortMod(datapath, port, address, properties=[optical])


def is_up(port: Any) -> bool:
    return not (port.config & ofproto.OFPPC_PORT_DOWN or port.state & ofproto.OFPPS_LINK_DOWN)


def is_fiber(port: Any) -> bool:
    return any(isinstance(prop, parser.OFPPortDescPropOptical) for prop in port.properties)


def is_inner(port: Any) -> bool:
    """Tell whether a port is inside a quantum switch, where neither fibre nor copper ends."""
    return _part(port) is not None


def modes_of(port: Any) -> int | None:
    """Return how many qubits a memory in a quantum switch takes, None of another port."""
    data = _part(port) or []
    return int(data[MODES]) if len(data) > MODES and data[0] >> 16 == Kind.MEMORY else None


def _part(port: Any) -> list[int] | None:
    """Return what our property of an inner port says, by 32 bits; None if there is none."""
    kind = parser.OFPPortDescPropExperimenter
    properties = (
        p for p in port.properties if isinstance(p, kind) and p.experimenter == EXPERIMENTER
    )
    return next((list(prop.data) for prop in properties), None)


def port_optics(port: Any) -> PortOptics | None:
    """Return how far a port can be tuned, None if it does not say so in frequencies."""
    for prop in port.properties:
        if isinstance(prop, parser.OFPPortDescPropOptical) and prop.supported & USE_FREQ:
            return PortOptics(
                prop.supported,
                prop.tx_min_freq_lmda,
                prop.tx_max_freq_lmda,
                prop.tx_grid_freq_lmda,
                prop.rx_min_freq_lmda,
                prop.rx_max_freq_lmda,
                prop.rx_grid_freq_lmda,
                signed(prop.tx_pwr_min),
                signed(prop.tx_pwr_max),
            )
    return None


def port_light(statistics: Any) -> PortLight | None:
    """Return how a port is tuned and what it measures, None if it has no optics."""
    for prop in statistics.properties:
        if isinstance(prop, parser.OFPPortStatsPropOptical):
            return PortLight(
                prop.flags,
                prop.tx_freq_lmda,
                prop.tx_offset,
                prop.tx_grid_span,
                prop.rx_freq_lmda,
                prop.rx_offset,
                prop.rx_grid_span,
                signed(prop.tx_pwr),
                signed(prop.rx_pwr),
                prop.bias_current,
                prop.temperature,
            )
    return None


def signed(value: int) -> int:
    """Return a number of 16 bits that the frameworks take as unsigned."""
    return value - (1 << 16) if value >> 15 else value
