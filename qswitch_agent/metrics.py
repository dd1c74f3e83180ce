"""The agent's metrics for Prometheus: what its hardware is asked, how long that takes."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

from programs.metrics import SECONDS
from qswitch_agent.hardware.optics import (
    Condition,
    CrossConnect,
    Direction,
    HardwareRefusal,
    OpticalHardware,
    Readings,
)
from wire.analyser_frames import AnalyserFrame, Emission


class MeasuredHardware:
    def __init__(self, hardware: OpticalHardware) -> None:
        self._hardware = hardware
        self.registry = CollectorRegistry()
        self._seconds = Histogram(
            "qmn_rpc_seconds",
            "What a call of the switch's hardware takes; until light passes, of cross_connects.",
            ["rpc"],
            buckets=SECONDS,
            registry=self.registry,
        )
        self._refusals = Counter(
            "qmn_hardware_refusals",
            "Calls that the hardware has refused.",
            ["rpc"],
            registry=self.registry,
        )
        self._paths = Gauge("qmn_light_paths", "Cross-connects that stand.", registry=self.registry)

    @contextmanager
    def _measured(self, rpc: str) -> Iterator[None]:
        started = time.perf_counter()
        try:
            yield
        except HardwareRefusal:
            self._refusals.labels(rpc).inc()
            raise
        finally:
            self._seconds.labels(rpc).observe(time.perf_counter() - started)

    async def set_cross_connects(self, cross_connects: Iterable[CrossConnect]) -> None:
        connections = list(cross_connects)
        with self._measured("cross_connects"):
            await self._hardware.set_cross_connects(connections)
        self._paths.set(len(connections))

    async def tune(
        self,
        port: int,
        frequency_mhz: int | None,
        power_dbm: float | None,
        direction: Direction = Direction.BOTH,
        cutoff_s: float | None = None,
    ) -> None:
        with self._measured("tune"):
            await self._hardware.tune(port, frequency_mhz, power_dbm, direction, cutoff_s)

    async def read(self) -> Readings:
        with self._measured("read"):
            return await self._hardware.read()

    async def watch(self, on_condition: Callable[[Condition], None]) -> None:
        await self._hardware.watch(on_condition)

    async def watch_analysers(self, on_report: Callable[[AnalyserFrame], None]) -> None:
        await self._hardware.watch_analysers(on_report)

    async def emit(self, port: int, emission: Emission) -> None:
        with self._measured("emit"):
            await self._hardware.emit(port, emission)

    async def keep(self, chosen: AnalyserFrame) -> None:
        with self._measured("keep"):
            await self._hardware.keep(chosen)

    async def close(self) -> None:
        await self._hardware.close()
