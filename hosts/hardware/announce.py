"""Announcements on the fibres' supervisory channel, by which a controller finds hosts."""

import socket
import time
from contextlib import suppress

from hosts.hardware.lldp import announcement
from hosts.network_loop import wall_sleep
from hosts.timeouts import ANNOUNCEMENT_PERIOD_S, ANNOUNCEMENT_TTL_S
from wire.features import Abilities

FAST_START = (0.2,) * 50  # pauses before the period begins, while the network starts


async def announce(
    name: str, address: str, ports: list[str], abilities: Abilities, key: str
) -> None:
    """Announce every fibre port for ever, quickly at first (802.1AB fast start)."""
    channels = {port: _open(port) for port in ports}
    try:
        pauses = iter(FAST_START)
        while True:
            for port, channel in channels.items():
                mac = channel.getsockname()[4]
                told = name, port, address, mac, ANNOUNCEMENT_TTL_S, abilities, key, time.time_ns()
                frame = announcement(*told)
                with suppress(OSError):  # a fibre that is set down says nothing
                    channel.send(frame)
            await wall_sleep(next(pauses, ANNOUNCEMENT_PERIOD_S))
    finally:
        for channel in channels.values():
            channel.close()


def _open(port: str) -> socket.socket:
    channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    channel.bind((port, 0))
    return channel
