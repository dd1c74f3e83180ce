"""Talk of a key manager with the controller: links, and routes for relayed keys.

Datagrams of applications.keys.route_messages, which the classical switch takes up to the controller
and to nobody else. Any may be lost: links are reported again and again, a question until it is
answered.
"""

import asyncio
import logging
import time
from collections.abc import Callable
from contextlib import suppress
from typing import cast

from applications.keys.config import KeyManagerConfig
from applications.keys.refusals import Refused, unavailable
from applications.keys.route_messages import (
    FROM_KEY_MANAGER,
    KEY_AGENT_PORT,
    MAX_LINKS,
    TO_KEY_MANAGER,
    KeyLinks,
    KeyRoute,
    KeyRouteRequest,
    LinkState,
)
from applications.timeouts import LINKS_PERIOD_S, ROUTE_PAUSE_S, ROUTE_TIMEOUT_S
from hosts.network_loop import background_sleep
from wire.device import DEVICE_PORT, Datagram, open_sealed
from wire.malformed import MalformedPacket
from wire.metadata.header import Message
from wire.metadata.setup import Answer

log = logging.getLogger("key-routes")


class Routes(asyncio.DatagramProtocol):
    """Speaks with the controller for one key manager."""

    def __init__(
        self, config: KeyManagerConfig, links: Callable[[], tuple[LinkState, ...]]
    ) -> None:
        self._config, self._links, self._time = config, links, config.time
        self._asked: dict[int, asyncio.Future[KeyRoute]] = {}
        self._heard = self._number = self._request = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep what to send through; called by asyncio."""
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, address: tuple[str, int]) -> None:
        """Take an answer of the controller; drop what is not from it, or was sent before."""
        try:
            message = self._open(data)
        except MalformedPacket as error:
            log.warning("dropped, from %s: %s", address[0], error)
            return
        future = self._asked.pop(message.session, None)
        if future is None or future.done():
            return
        if isinstance(message, KeyRoute):
            future.set_result(message)
        elif isinstance(message, Answer):
            future.set_exception(unavailable(f"the controller: {message.text}"))

    def error_received(self, error: Exception) -> None:
        """Go on: send again what could not be sent."""
        log.info("not sent: %s", error)

    def _open(self, data: bytes) -> Message:
        datagram = open_sealed(data, self._config.device_key, TO_KEY_MANAGER)
        if datagram.host != self._config.host or datagram.number <= self._heard:
            raise MalformedPacket(
                f"for {datagram.host}, number {datagram.number}: not new, or not ours"
            )
        self._heard = datagram.number
        return datagram.message

    async def run(self) -> None:
        while True:
            links = await asyncio.to_thread(self._links)
            if links:
                self._send(KeyLinks(0, links[:MAX_LINKS]))
            await background_sleep(LINKS_PERIOD_S)

    async def ask(self, host: str, stored: int, master: str, slave: str) -> KeyRoute:
        """Return the manager by which stored keys can go to a host; raise Refused if none."""
        self._request += 1
        number = self._request
        answer = self._asked[number] = asyncio.get_running_loop().create_future()
        # Stored keys may have changed since links were last reported.
        self._send(KeyLinks(0, (await asyncio.to_thread(self._links))[:MAX_LINKS]))
        request = KeyRouteRequest(number, self._config.hosts[host], stored, master, slave)
        try:
            async with asyncio.timeout(self._time.network_s(ROUTE_TIMEOUT_S)):
                return await self._repeat(request, answer)
        except TimeoutError:
            text = f"the controller has not answered in {ROUTE_TIMEOUT_S:g} s"
            raise unavailable(f"{text} by whom keys can go to {host}") from None
        finally:
            self._asked.pop(number, None)

    async def _repeat(
        self, request: KeyRouteRequest, answer: "asyncio.Future[KeyRoute]"
    ) -> KeyRoute:
        while True:
            self._send(request)
            with suppress(TimeoutError):
                async with asyncio.timeout(self._time.network_s(ROUTE_PAUSE_S)):
                    return await asyncio.shield(answer)

    async def register(self, host: str, master: str, slave: str) -> None:
        try:
            await self.ask(host, 0, master, slave)
        except Refused as error:
            log.info("%s and %s are not registered: %s", master, slave, error)

    def _send(self, message: Message) -> None:
        self._number = max(self._number + 1, time.time_ns())
        datagram = Datagram(message, self._config.host, self._number)
        data = datagram.seal(self._config.device_key, FROM_KEY_MANAGER)
        self._transport.sendto(data, (self._config.report_to, DEVICE_PORT))

    def close(self) -> None:
        self._transport.close()


async def open_routes(
    config: KeyManagerConfig, links: Callable[[], tuple[LinkState, ...]]
) -> Routes:
    """Open the port; raise OSError if it is taken."""
    _transport, routes = await asyncio.get_running_loop().create_datagram_endpoint(
        lambda: Routes(config, links),
        local_addr=(config.address, KEY_AGENT_PORT),
        allow_broadcast=True,
    )
    return routes
