"""A quantum switch's condition and statistics, as they go over the wire."""

from collections.abc import Mapping

from dispatcher.switch.optical_switch import MAX_POWER_DBM, OpticalSwitch
from wire.dispatcher_pb2 import Connection, SwitchCondition, SwitchStatisticsReply


def condition(switch: OpticalSwitch) -> SwitchCondition:
    """Return what a switch is and how it is; losses include what heat adds."""
    config = switch.config
    return SwitchCondition(
        temperature_c=switch.temperature_c,
        hot=switch.hot,
        loss_db=config.insertion_loss_db + switch.hot_loss_db,
        rotation=config.rotation,
        paths=[
            SwitchCondition.PathOptics(
                in_port=path.in_port,
                out_port=path.out_port,
                loss_db=path.insertion_loss_db,
                rotation=path.rotation,
            )
            for path in switch.paths
        ],
        stuck=[Connection(in_port=i, out_port=o) for i, o in sorted(switch.stuck.items())],
        min_frequency_mhz=config.min_frequency_mhz,
        max_frequency_mhz=config.max_frequency_mhz,
        grid_mhz=config.grid_mhz,
        min_power_dbm=config.min_power_dbm,
        max_power_dbm=MAX_POWER_DBM,
        channels=[
            SwitchCondition.Channel(
                port=number,
                frequency_mhz=port.channel.frequency_mhz,
                grid_mhz=port.channel.grid_mhz,
            )
            for number, port in switch.ports.items()
            if port.channel is not None
        ],
    )


def statistics(
    switch: OpticalSwitch, rx_power_dbm: Mapping[int, float], now_ns: int
) -> SwitchStatisticsReply:
    """Return what a switch has counted of the light that has passed it, port by port."""
    reply = SwitchStatisticsReply(temperature_c=switch.temperature_c)
    for number, port in switch.ports.items():
        reply.ports.add(
            port=number,
            photons_in=port.photons_in,
            photons_out=port.photons_out,
            photons_lost=port.photons_lost,
            frequency_mhz=int(port.tx_mhz.now),
            rx_frequency_mhz=int(port.rx_mhz.now),
            power_dbm=port.power_dbm.now,
            rx_power_dbm=rx_power_dbm[number],
            bias_ma=port.bias_ma,
        )
    for circuit in switch.circuits(now_ns):
        reply.circuits.add(
            circuit=circuit.number,
            photons=circuit.photons,
            since_ns=circuit.since_ns,
            last_ns=circuit.last_ns,
        )
    return reply
