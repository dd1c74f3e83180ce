"""The node agent: answers the controller about this host's device, and lets it be set.

Datagrams of wire.device on a UDP port of the host's CNIC. Only the controller can speak to
it: it knows the device key, and the classical switch passes nobody else's datagrams on.
"""

import asyncio
import logging
import math
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from typing import cast

from hosts.hardware.ports import link_changes, take_notices
from hosts.middleware.device import Device, changed
from hosts.middleware.session.errors import SessionError
from hosts.network_loop import background_timeout
from hosts.serving.link_monitors import LinkMonitors
from hosts.timeouts import (
    CHECK_PERIOD_S,
    FASTEST_ANNOUNCEMENTS_S,
    IDLE_CHECK_PERIOD_S,
    SLOWER,
    UNSUBSCRIBED_PERIOD_S,
)
from wire.config import HostConfig
from wire.device import (
    DEVICE_PORT,
    Datagram,
    DeviceQuery,
    DeviceReport,
    SessionQuery,
    SetDevice,
    Subscribe,
    open_sealed,
)
from wire.malformed import MalformedPacket
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason
from wire.monitor_messages import MonitorCommand, PreemptMonitor

log = logging.getLogger("node-agent")

UNASKED_AFTER = 3  # periods without a request: report, so that a new controller finds the host


class NodeAgent(asyncio.DatagramProtocol):
    def __init__(
        self,
        config: HostConfig,
        device: Device,
        monitors: LinkMonitors,
        takes_part: Callable[[int], bool],
    ) -> None:
        self._name = config.name
        self._background_s = config.time.background_s
        self._key = config.device_key
        self._report_to = config.report_to
        self._device, self._monitors = device, monitors
        self._takes_part = takes_part
        self._heard = 0  # number of the last datagram that was taken
        self._number = 0
        self._last = device.report()
        self._changed = asyncio.Event()
        self._alarmed = asyncio.Event()
        self.found = asyncio.Event()  # the controller knows where this host is
        device.changed, device.alarmed = self._changed.set, self._alarmed.set
        self._sent_s = self._asked_s = -math.inf
        self._began_s = self._background_s()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep what to send through; called by asyncio."""
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, address: tuple[str, int]) -> None:
        """Do what the controller asks; drop what is not from it, or was sent before."""
        try:
            message = self._open(data)
        except MalformedPacket as error:
            log.warning("dropped, from %s: %s", address[0], error)
            return
        self._asked_s = self._background_s()
        if isinstance(message, SetDevice):
            self._set(message)
        elif isinstance(message, Subscribe):
            self._device.subscription = message
            self.found.set()
            self._report(message.session)
        elif isinstance(message, MonitorCommand):
            self._send(self._monitors.take(message))
        elif isinstance(message, PreemptMonitor):
            self._send(self._monitors.preempt(message))
        elif isinstance(message, SessionQuery):
            there = self._takes_part(message.about)
            self._send(Answer(message.session, Reason.OK if there else Reason.UNKNOWN_SESSION))
        elif isinstance(message, DeviceQuery):
            self._report(message.session)
        else:
            log.warning("dropped: %s is not for a node agent", type(message).__name__)

    def error_received(self, error: Exception) -> None:
        """Go on: a report that could not be sent is followed by the next."""
        log.info("a report was not sent: %s", error)

    def _open(self, data: bytes) -> Message:
        datagram = open_sealed(data, self._key, Datagram.FROM_CONTROLLER)
        if datagram.host != self._name or datagram.number <= self._heard:
            raise MalformedPacket(
                f"for {datagram.host}, number {datagram.number}: not new, or not ours"
            )
        self._heard = datagram.number
        return datagram.message

    def _set(self, message: SetDevice) -> None:
        try:
            self._device.set(message.settings)
        except SessionError as error:
            self._send(Answer(message.session, error.reason, str(error)))
            return
        log.info("the controller has set %s", message.settings)
        self._send(Answer(message.session, Reason.OK))
        self._report()

    async def run(self) -> None:
        """Report what changes or alarms, for ever; and now and then if nobody asks."""
        loop = asyncio.get_running_loop()
        with link_changes() as links:
            loop.add_reader(links.fileno(), self._take_notices, links)
            try:
                while True:
                    self._look()
                    await self._pause()
            finally:
                loop.remove_reader(links.fileno())

    def _take_notices(self, links: socket.socket) -> None:
        take_notices(links)
        self._changed.set()

    def _look(self) -> None:
        """Report if something has changed or alarms, or if nobody asks; tell new estimates."""
        now, report = self._background_s(), self._device.report()
        alone = now > self._alone_s
        if changed(self._last, report) or alone or self._alarms(report, now - self._period_s):
            self._report()
        for estimate in self._device.new_estimates():
            self._send(estimate)

    async def _pause(self) -> None:
        """Wait for the next look: for that of a device at work, or until something happens.

        An alarm of a link monitor closes fibres, and does not wait.
        """
        if self._device.at_work:
            with suppress(TimeoutError):
                async with background_timeout(CHECK_PERIOD_S):
                    await self._alarmed.wait()
            self._alarmed.clear()
            return
        alone_s = max(self._alone_s - self._background_s(), CHECK_PERIOD_S)
        with suppress(TimeoutError):
            async with background_timeout(min(alone_s, IDLE_CHECK_PERIOD_S)):
                await self._changed.wait()
        self._changed.clear()

    @property
    def _period_s(self) -> float:
        """How often to report: as the controller wants, until then ever more rarely."""
        if self._device.subscription.period_ms:
            return self._device.subscription.period_ms / 1e3
        waited_s = self._background_s() - self._began_s
        return min(max(FASTEST_ANNOUNCEMENTS_S, SLOWER * waited_s), UNSUBSCRIBED_PERIOD_S)

    @property
    def _alone_s(self) -> float:
        """When to report although nobody has asked."""
        asked_s = self._asked_s + UNASKED_AFTER * self._period_s
        return max(asked_s, self._sent_s + self._period_s)

    def _alarms(self, report: DeviceReport, since: float) -> bool:
        return self._sent_s <= since and self._device.alarming(self._last, report)

    def _report(self, session: int = 0) -> None:
        self._last = self._device.report(session)
        self._sent_s = self._background_s()
        self._send(self._last)

    def _send(self, message: Message) -> None:
        self._number = max(self._number + 1, time.time_ns())
        datagram = Datagram(message, self._name, self._number)
        data = datagram.seal(self._key, Datagram.FROM_HOST)
        self._transport.sendto(data, (self._report_to, DEVICE_PORT))


async def start_node_agent(
    config: HostConfig,
    device: Device,
    monitors: LinkMonitors,
    takes_part: Callable[[int], bool],
) -> NodeAgent:
    """Open the port; raise OSError if it is taken. The host says in which sessions it is."""
    _transport, agent = await asyncio.get_running_loop().create_datagram_endpoint(
        lambda: NodeAgent(config, device, monitors, takes_part), sock=agent_port(config.address)
    )
    return agent


def agent_port(address: str) -> socket.socket:
    """Return a socket for datagrams from the controller and to it, wherever it is."""
    port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        port.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        port.setblocking(False)
        port.bind((address, DEVICE_PORT))
    except OSError:
        port.close()
        raise
    return port
