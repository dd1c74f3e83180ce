"""q0 of one host: packets from the kernel to the other hosts' light, and from theirs back.

kernel --q0--> reader --> Outgoing of a host (a thread each) --> its light
kernel <--q0-- a thread for each session of another host    <-- its light
"""

import logging
import threading
from collections.abc import Callable, Set
from contextlib import suppress
from ipaddress import IPv4Address, IPv4Network, IPv6Address, ip_address

from applications.ip_over_light.format import IpOverLightConfig
from applications.ip_over_light.ip_packet import PacketStream, decode, unreachable
from applications.ip_over_light.lost_packet import Packet, Unreachable
from applications.ip_over_light.outgoing import PORTS, Outgoing, WantedLight
from applications.ip_over_light.tun import Tun
from hosts.quantum_socket import QuantumSocket
from hosts.stack_socket import QuantumSocketError, StackEnded
from wire.malformed import MalformedPacket

log = logging.getLogger("q0")

READ_BYTES = 1 << 16


class Interface:
    """The packets of one host; `start` begins, `failed` is called with what ends it."""

    def __init__(
        self, config: IpOverLightConfig, tun: Tun, failed: Callable[[BaseException], None]
    ) -> None:
        self._config, self._tun, self._failed = config, tun, failed
        texts = [each for each in (config.address, config.address6) if each]
        self._addresses = {address.version: address for address in map(ip_address, texts)}
        routers = [each for each in (config.router, config.router6) if each]
        self._routers = {address.version: address for address in map(ip_address, routers)}
        self._network = IPv4Network((config.address, config.prefix_length), strict=False)
        self._listeners: list[QuantumSocket] = []
        wanted_light = WantedLight()
        outgoing = [
            Outgoing(
                config.stack,
                neighbor,
                config.options,
                config.time.wall_s(config.idle_s),
                config.time.wall_s(config.patience_s),
                self.refuse,
                wanted_light,
            )
            for neighbor in config.neighbors
        ]
        self._by_address = {
            ip_address(address): each
            for each in outgoing
            for address in (each.neighbor.address, each.neighbor.address6)
            if address
        }
        self._carrying: set[str] = set()  # hosts that have a thread: all ever sent to
        self._by_copper = {each.neighbor.copper: each for each in outgoing}

    def start(self) -> None:
        """Listen for others, and begin to carry; QuantumSocketError if others listen there."""
        for service, port in PORTS.items():
            listener = QuantumSocket(self._config.stack)
            listener.listen(port, service)
            self._listeners.append(listener)
            self._begin(self._accept, listener, service)
        self._begin(self._read)

    def _begin(self, work: Callable[..., None], *arguments: object) -> None:
        """Do something in a thread; its fault is that of all."""

        def watched() -> None:
            try:
                work(*arguments)
            except (QuantumSocketError, OSError) as error:
                self._failed(error)

        threading.Thread(target=watched, daemon=True, name=work.__qualname__).start()

    def _read(self) -> None:
        while True:
            data = self._tun.read()
            try:
                self.send(decode(data, self._config.mtu))
            except MalformedPacket as error:
                log.warning("not sent: %s", error)

    def send(self, packet: Packet) -> None:
        """Let a packet go to whom it is for, or tell its sender why it cannot."""
        outgoing = self._by_address.get(packet.destination)
        if outgoing is None:
            self.refuse(packet, Unreachable.HOST_UNKNOWN)
            return
        if outgoing.neighbor.host not in self._carrying:
            self._carrying.add(outgoing.neighbor.host)
            self._begin(outgoing.run)
        outgoing.offer(packet)

    def refuse(self, packet: Packet, why: Unreachable) -> None:
        if packet.may_be_answered and packet.destination != self._network.broadcast_address:
            self._tun.write(unreachable(packet, why, self._routers[packet.source.version]))

    def _accept(self, listener: QuantumSocket, service: str) -> None:
        while True:
            connection, peer = listener.accept()
            outgoing = self._by_copper.get(peer)
            if outgoing is None:
                log.warning("light of %s, which has no q0 here, is not taken", peer)
                connection.close()
                continue
            outgoing.incoming(service, 1)
            self._begin(self._receive, connection, outgoing, service)

    def _receive(self, connection: QuantumSocket, outgoing: Outgoing, service: str) -> None:
        """Pass on what one session of another host brings, until its end."""
        stream = PacketStream(self._config.mtu)
        addresses = outgoing.neighbor.address, outgoing.neighbor.address6
        sources = {ip_address(address) for address in addresses if address}
        try:
            with connection:
                while data := connection.recv(READ_BYTES):
                    for packet in stream.feed(data):
                        self.deliver(packet, sources)
        except StackEnded:
            raise
        except (QuantumSocketError, MalformedPacket) as error:
            log.warning("from %s: %s", outgoing.neighbor.host, error)
        finally:
            outgoing.incoming(service, -1)

    def deliver(self, packet: Packet, sources: Set[IPv4Address | IPv6Address]) -> None:
        address = self._addresses.get(packet.destination.version)
        if packet.source in sources and packet.destination == address:
            self._tun.write(packet.data)
        else:
            log.warning("dropped: a packet of %s for %s", packet.source, packet.destination)

    def close(self) -> None:
        for listener in self._listeners:
            with suppress(OSError):
                listener.close()
