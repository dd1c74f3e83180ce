"""The controller's metrics for Prometheus: of light paths as recorded, of hosts when asked.

The hosts' metrics are those of their last reports (the device monitor's polls).
"""

import logging
import socket
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from controller_apps.console.facts import Facts
from controller_apps.console.questions import Refused
from controller_apps.openflow.framework import EndOnFault, hub
from controller_apps.record import Record
from programs.metrics import (
    END,
    MAX_HEAD_BYTES,
    SECONDS,
    answer,
    inherited,
    unavailable,
)
from programs.timeouts import METRICS_TIMEOUT_S
from wire.network_time import REAL_TIME, NetworkTime

COUNTS = {
    "pairs_made": "Bell pairs that the host has made.",
    "pairs_sent": "Bell pairs that the host has sent symbols with.",
    "pairs_received": "Bell pairs that the host has received.",
    "pairs_lost": "Bell pairs, sent or received, that were lost.",
    "symbol_errors": "Symbols, sent or received, that were wrong.",
    "repeated_frames": "Frames that were sent again.",
}
log = logging.getLogger("metrics")


class MeasuredRecord(Record):
    """A record that also counts its facts, and measures the set-up of light paths."""

    def __init__(
        self, path: str, registry: CollectorRegistry, time: NetworkTime = REAL_TIME
    ) -> None:
        super().__init__(path, time)
        self._facts = Counter(
            "qmn_controller_facts", "What has happened, by kind.", ["event"], registry=registry
        )
        self._setup_seconds = Histogram(
            "qmn_path_setup_seconds",
            "From a request for light to its path being ready.",
            buckets=SECONDS,
            registry=registry,
        )

    def write(self, event: str, **fields: Any) -> None:
        super().write(event, **fields)
        self._facts.labels(event).inc()
        if "setup_ms" in fields:
            self._setup_seconds.observe(fields["setup_ms"] / 1e3)


class CurrentMetrics(Collector):
    """Counts that the apps keep anyway."""

    def __init__(self, facts: Facts) -> None:
        self._facts = facts

    def describe(self) -> Iterator[Metric]:
        """Yield nothing: what there is, is known when the apps are asked."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """Yield every metric as it is now; raise Refused if the apps do not answer."""
        devices = self._facts.devices()
        # A host that was never heard has no counts.
        hosts = [device for device in devices if device["kind"] == "host" and "sessions" in device]
        for name, text in COUNTS.items():
            count = CounterMetricFamily(f"qmn_{name}", text, labels=["host"])
            for host in hosts:
                count.add_metric([host["name"]], host[name])
            yield count
        sessions = GaugeMetricFamily("qmn_sessions", "Sessions that run.", labels=["host", "role"])
        for host in hosts:
            for role, number in host["sessions"].items():
                sessions.add_metric([host["name"], role], number)
        yield sessions
        yield CounterMetricFamily(
            "qmn_packet_ins",
            "Packets that switches have sent up.",
            self._facts.quantum.journal.packet_ins,
        )


class Metrics:
    """Serves one request after the other, each with a deadline, beside the apps."""

    def __init__(self, descriptor: int) -> None:
        self.registry = CollectorRegistry()
        self._listener = inherited(descriptor)

    def record(self, path: str, time: NetworkTime) -> Record:
        """Return a record whose facts are counted; an empty path records nothing else."""
        return MeasuredRecord(path, self.registry, time)

    def start(self, facts: Facts) -> None:
        self.registry.register(CurrentMetrics(facts))
        hub.spawn(self.serve)

    def serve(self) -> None:
        with EndOnFault("metrics"):
            while True:
                connection, _ = self._listener.accept()
                with closing(connection):
                    self._serve(connection)

    def _serve(self, connection: socket.socket) -> None:
        try:
            connection.sendall(self._answer(_head(connection)))
        except OSError as error:  # TimeoutError is one
            log.info("a connection ended: %s", error)

    def _answer(self, head: bytes) -> bytes:
        try:
            return answer(head, self.registry)
        except Refused as refused:
            return unavailable(str(refused))


def _head(connection: socket.socket) -> bytes:
    """Return what comes up to the end of a request's head, or more than fits."""
    deadline, head = time.monotonic() + METRICS_TIMEOUT_S, b""
    while END not in head and len(head) < MAX_HEAD_BYTES:
        connection.settimeout(max(deadline - time.monotonic(), 1e-3))
        data = connection.recv(MAX_HEAD_BYTES - len(head))
        if not data:
            break
        head += data
    return head
