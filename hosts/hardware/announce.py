"""Announcements on the fibres' supervisory channel, by which a controller finds hosts."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

from hosts.network_loop import background_sleep
from hosts.timeouts import ANNOUNCEMENTS_HELD, FASTEST_ANNOUNCEMENTS_S, SLOWER
from wire.config import HostConfig
from wire.lldp import PERIOD_S, announcement


async def announce(config: HostConfig, found: Callable[[], bool]) -> None:
    """Announce every fibre port for ever, quickly at first (802.1AB fast start).

    When the controller has found this host, that is repeated for one that starts again, as rarely
    in the end as so large a network needs for its controller to take all in.
    """
    channels = {port: _open(port) for port in config.qnics}
    ttl_s = round(ANNOUNCEMENTS_HELD * config.announcement_period_s)
    try:
        for pause_s in pauses(lambda: config.announcement_period_s if found() else PERIOD_S):
            for port, channel in channels.items():
                frame = announcement(
                    config.name,
                    port,
                    config.address,
                    channel.getsockname()[4],
                    ttl_s,
                    config.node_features,
                    config.device_key,
                    time.time_ns(),
                )
                with suppress(OSError):  # a fibre that is set down says nothing
                    channel.send(frame)
            await background_sleep(pause_s)
    finally:
        for channel in channels.values():
            channel.close()


def pauses(longest_s: Callable[[], float]) -> Iterator[float]:
    """Yield the pauses between announcements: short at first, and longer the longer it takes.

    So the fibres of a large network, which starts for minutes, do not all speak all the time.
    """
    passed_s = 0.0
    while True:
        pause_s = min(max(FASTEST_ANNOUNCEMENTS_S, SLOWER * passed_s), longest_s())
        passed_s += pause_s
        yield pause_s


def _open(port: str) -> socket.socket:
    channel = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    channel.bind((port, 0))
    return channel
