"""Packets on their way to one other host: queued, and carried by light that is had on demand.

        packets                 no light
  idle --------> asking for light ------> each packet answered by ICMP, for HOLDOFF_S
    ^              | light
    '- idle_s -- carrying, a batch at a time

The first of two hosts to send opens a session of superdense coding (`sdc`). The other one answers
by its light (`sdc_return`), as long as that session stands: so both directions have light at once.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from applications.ip_over_light.format import PACKETS_PORT, RETURNED_PACKETS_PORT, Neighbor
from applications.ip_over_light.lost_packet import Packet, Unreachable
from applications.ip_over_light.refusals import PASSING, code
from applications.timeouts import HOLDOFF_S, LIGHT_RETRY_S, YIELD_S
from hosts.quantum_socket import QuantumSocket
from hosts.stack_socket import QuantumSocketError, StackEnded
from wire.metadata.vocabulary import Service

log = logging.getLogger("q0")

SENT = Service.SDC.name.lower()
RETURNED = Service.SDC_RETURN.name.lower()
PORTS = {SENT: PACKETS_PORT, RETURNED: RETURNED_PACKETS_PORT}
MOST_QUEUED_BYTES = 1 << 18  # then the interface's own queue fills, as that of a slow link
BATCH_BYTES = 1 << 16  # that travel at a time: behind them waits what comes meanwhile
ATTEMPTS = 2  # of a batch whose session breaks: the other end may just have given light back

Refuse = Callable[[Packet, Unreachable], None]


class WantedLight:
    """The hosts for which this one waits for light, which others of its sessions may have."""

    def __init__(self) -> None:
        self._hosts: list[str] = []  # by all threads, a whole step at a time

    @contextmanager
    def wanted(self, host: str) -> Iterator[None]:
        self._hosts.append(host)
        try:
            yield
        finally:
            self._hosts.remove(host)

    def others_want(self, host: str) -> bool:
        return any(other != host for other in self._hosts)


class Outgoing:
    """Packets from this host to one other; `offer` from any thread, `run` in one of its own.

    How long it keeps light without a packet, and waits for light, are seconds of the wall here.
    """

    def __init__(
        self,
        stack: str,
        neighbor: Neighbor,
        options: dict[str, Any],
        idle_s: float,
        patience_s: float,
        refuse: Refuse,
        elsewhere: WantedLight,
    ) -> None:
        self.neighbor = neighbor
        self._elsewhere = elsewhere
        self._stack, self._options, self._refuse = stack, dict(options), refuse
        if neighbor.source:
            self._options["source"] = neighbor.source
        self._idle_s, self._patience_s = idle_s, patience_s
        self._queue: deque[Packet] = deque()
        self._queued_bytes = 0
        self._refused: tuple[Unreachable, float] | None = None  # until when
        self._incoming: dict[str, int] = dict.fromkeys(PORTS, 0)  # sessions of the other host
        self._returned_on: QuantumSocket | None = None  # light of the other host's session
        self._broken = 0  # sessions, since the last batch that has arrived
        self._changed = threading.Condition()

    def offer(self, packet: Packet) -> None:
        """Queue a packet; waits while the queue is full."""
        with self._changed:
            while self._queued_bytes >= MOST_QUEUED_BYTES:
                self._changed.wait()
            refused = self._refused
            if refused is None or time.monotonic() >= refused[1]:
                self._refused = None
                self._queue.append(packet)
                self._queued_bytes += len(packet.data)
                self._changed.notify_all()
                return
        self._refuse(packet, refused[0])

    def incoming(self, service: str, sessions: int) -> None:
        """Count more sessions of the other host that bring packets.

        A return has no light without the session that it goes back on.
        """
        with self._changed:
            self._incoming[service] += sessions
            if self._returned_on is not None and not self._incoming[SENT]:
                stranded, self._returned_on = self._returned_on, None
                stranded.close()  # its waiters hear of that
            self._changed.notify_all()

    def run(self) -> None:
        """Carry packets for ever; raise StackEnded when the host's stack has ended."""
        while True:
            self._wait_for_packets(None)
            try:
                with self._elsewhere.wanted(self.neighbor.host):
                    service, light = self._asked()
            except StackEnded:
                raise
            except QuantumSocketError as error:
                self._give_up(error)
            else:
                self._carry_unless_broken(service, light)

    def _carry_unless_broken(self, service: str, light: QuantumSocket) -> None:
        """Carry packets; those of a session that breaks go another time, but not for ever."""
        try:
            with light:
                self._carry(service, light)
        except StackEnded:
            raise
        except QuantumSocketError as error:
            self._broken += 1
            log.warning("%s: light lost (%s): %s", self.neighbor.host, service, error)
            if self._broken >= ATTEMPTS:
                self._give_up(error)
        finally:
            with self._changed:
                self._returned_on = None

    def _carry(self, service: str, light: QuantumSocket) -> None:
        """Carry packets while there are any, then give the light back."""
        began = time.monotonic()
        log.info("%s: light (%s)", self.neighbor.host, service)
        while self._goes_on(service):
            batch = self._batch()
            light.sendall(b"".join(packet.data for packet in batch))
            self._sent(batch)
        light.shutdown()
        used = light.statistics
        log.info(
            "%s: light given back (%s) after %.3f s; %d bytes, %d pairs, %d lost, %d frames again",
            *(self.neighbor.host, service, time.monotonic() - began, used["delivered_bytes"]),
            *(used["bell_pairs"], used["lost_pairs"], used["repeated_frames"]),
        )

    def _asked(self) -> tuple[str, QuantumSocket]:
        """Return light and its kind; QuantumSocketError if there is none for so long."""
        deadline = time.monotonic() + self._patience_s
        while True:
            service = RETURNED if self._incoming[SENT] else SENT
            light = QuantumSocket(self._stack)
            try:
                address = self.neighbor.host, PORTS[service]
                list(light.request(service, address, **self._options))
            except QuantumSocketError as error:
                light.close()
                if error.reason not in PASSING or time.monotonic() > deadline:
                    raise
            else:
                if self._stands(service, light):
                    return service, light
                light.close()
            with self._changed:
                self._changed.wait(LIGHT_RETRY_S)

    def _stands(self, service: str, light: QuantumSocket) -> bool:
        """Note the session of a return; tell whether it still exists."""
        with self._changed:
            if service == RETURNED:
                self._returned_on = light if self._incoming[SENT] else None
                return self._returned_on is not None
            return True

    def _goes_on(self, service: str) -> bool:
        """Wait for packets; return whether there are any before light is to be given back.

        A session stays as long as the other end answers on its light. Where this host wants
        light for another one, it is given back sooner.
        """
        idle_since = time.monotonic()
        while not self._wait_for_packets(min(YIELD_S, self._idle_s)):
            if self._elsewhere.others_want(self.neighbor.host):
                return False
            if time.monotonic() - idle_since >= self._idle_s:
                with self._changed:
                    if service == RETURNED or not self._incoming[RETURNED]:
                        return False
        return True

    def _wait_for_packets(self, timeout_s: float | None) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._queue), timeout_s)

    def _batch(self) -> list[Packet]:
        """Return the packets to travel next; they stay in the queue until they have arrived."""
        with self._changed:
            batch: list[Packet] = []
            size = 0
            for packet in self._queue:
                size += len(packet.data)
                if batch and size > BATCH_BYTES:
                    break
                batch.append(packet)
            return batch

    def _sent(self, batch: list[Packet]) -> None:
        with self._changed:
            self._broken = 0
            for packet in batch:
                self._queue.popleft()
                self._queued_bytes -= len(packet.data)
            self._changed.notify_all()

    def _give_up(self, error: QuantumSocketError) -> None:
        """Answer what waits by ICMP, and what comes in the next moment as well."""
        log.warning("%s: no light: %s", self.neighbor.host, error)
        why = code(error.reason)
        with self._changed:
            lost = list(self._queue)
            self._queue.clear()
            self._queued_bytes = 0
            self._broken = 0
            self._refused = why, time.monotonic() + HOLDOFF_S
            self._changed.notify_all()
        for packet in lost:
            self._refuse(packet, why)
