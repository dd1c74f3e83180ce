"""The dispatcher's metrics for Prometheus: read when asked for, but for the time of calls."""

from collections.abc import Iterator
from typing import Any

from prometheus_client import CollectorRegistry, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.server.callers import Callers
from dispatcher.server.servicer import Failed, Service
from programs.metrics import SECONDS


class MeasuredService(Service):
    def __init__(
        self, layer: PhysicalLayer, callers: Callers, failed: Failed, looking: bool = False
    ) -> None:
        super().__init__(layer, callers, failed, looking)
        self.registry = CollectorRegistry()
        self.registry.register(CurrentMetrics(self))
        self._seconds = Histogram(
            "qmn_rpc_seconds",
            "What a request takes; send and receive wait for light.",
            ["rpc"],
            buckets=SECONDS,
            registry=self.registry,
        )

    async def change(self, node: str, kind: str, request: Any) -> Any:
        with self._seconds.labels(kind).time():
            return await super().change(node, kind, request)


class CurrentMetrics(Collector):
    """Counts that the physical layer keeps anyway."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def collect(self) -> Iterator[Metric]:
        status = self._service.status()
        yield CounterMetricFamily(
            "qmn_pairs_created", "Bell pairs that sources have made.", value=status.pairs_created
        )
        yield CounterMetricFamily(
            "qmn_photons_lost", "Photons lost on their way or in memories.", status.photons_lost
        )
        yield CounterMetricFamily("qmn_events", "Quantum events.", status.events)
        yield CounterMetricFamily(
            "qmn_events_dropped", "Events that slow watchers have lost.", self._dropped()
        )
        yield GaugeMetricFamily("qmn_live_qubits", "Qubits that are simulated.", status.live_qubits)
        yield GaugeMetricFamily(
            "qmn_live_bytes", "Memory that holds their state.", status.live_bytes
        )

    def _dropped(self) -> int:
        return self._service.layer.history.dropped
