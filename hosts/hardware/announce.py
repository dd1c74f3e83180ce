"""Announcements on the fibres' supervisory channel, by which a controller finds hosts."""

import socket
import time
from collections.abc import Iterator
from contextlib import suppress

from hosts.hardware.lldp import announcement
from hosts.network_loop import wall_sleep
from hosts.timeouts import (
    ANNOUNCEMENT_PERIOD_S,
    ANNOUNCEMENT_TTL_S,
    FASTEST_ANNOUNCEMENTS_S,
    SLOWER,
)
from wire.features import NodeFeatures


async def announce(
    name: str, address: str, ports: list[str], node_features: NodeFeatures, key: str
) -> None:
    """Announce every fibre port for ever, quickly at first (802.1AB fast start)."""
    channels = {port: _open(port) for port in ports}
    try:
        for pause in pauses():
            for port, channel in channels.items():
                mac = channel.getsockname()[4]
                told = (
                    name,
                    port,
                    address,
                    mac,
                    ANNOUNCEMENT_TTL_S,
                    node_features,
                    key,
                    time.time_ns(),
                )
                frame = announcement(*told)
                with suppress(OSError):  # a fibre that is set down says nothing
                    channel.send(frame)
            await wall_sleep(pause)
    finally:
        for channel in channels.values():
            channel.close()


def pauses() -> Iterator[float]:
    """Yield the pauses between announcements: short at first, and longer the longer it takes.

    So the fibres of a large network, which starts for minutes, do not all speak all the time.
    """
    passed_s = 0.0
    while True:
        pause_s = min(max(FASTEST_ANNOUNCEMENTS_S, SLOWER * passed_s), ANNOUNCEMENT_PERIOD_S)
        passed_s += pause_s
        yield pause_s


def _open(port: str) -> socket.socket:
    channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    channel.bind((port, 0))
    return channel
