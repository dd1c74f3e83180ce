"""Pairs a second through the physical layer alone, superdense coding with every noise on.

charlie-q0 --1 q1 3-- alice-q0      bob-q0 --4 q1 5-- bob-q1
charlie-q1 --2 q1

No network and no gRPC: the dispatcher's own operations, on a clock that jumps.
"""

import asyncio
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from dispatcher.layer import PhysicalLayer
from dispatcher.measurements import Measurements
from dispatcher.operations import Operations
from dispatcher.ownership import BlockName
from dispatcher.server import build_layer
from dispatcher.switching import Switching
from dispatcher.transport import Transport
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import Connection, CreateRequest
from wire.physics import BellAnalyser, Detectors, Device, PairSource

PAIRS = 1_000_000
TURNS = 5  # the load of a machine changes: the best counts
RATE_HZ = 50_000_000
DEADLINE_S = 60.0
NOISY_FIBER: dict[str, Any] = {
    "length_km": 1.0,
    "loss_db_per_km": 0.2,
    "depolarizing": 0.01,
    "dephasing": 0.005,
    "drift_rad_per_sqrt_km": 0.1,
    "drift_time_s": 10.0,
    "burst_depolarizing": 0.3,
    "temperature_walk_k_per_sqrt_s": 0.1,
    "classical_mw": 0.01,
}
NOISY_DEVICES = {
    "charlie": Device(PairSource("poisson", 0.5, 0.97, jitter_ps=20.0)),
    "bob": Device(
        detectors=Detectors(0.8, 1e3, 1e-9, 5e-8, 0.02, 1e-7, 50.0),
        analyser=BellAnalyser("complete", 0.98, 1e10, 1e-9),
    ),
}
PORTS = {"charlie-q0": 1, "charlie-q1": 2, "alice-q0": 3, "bob-q0": 4, "bob-q1": 5}
PATHS = {1: 3, 3: 4, 2: 5}


class JumpingClock:
    """A clock that jumps to whatever time is waited for."""

    def __init__(self) -> None:
        """Begin now."""
        self._time_ns = time.time_ns()

    def now_ns(self) -> int:
        """Return the time."""
        return self._time_ns

    async def wait_until(self, time_ns: int) -> None:
        """Jump to just after the time."""
        self._time_ns = max(self._time_ns, time_ns + 1)


def layer_speed() -> Iterator[tuple[str, str]]:
    """Yield name and text of the figure."""
    rate = PAIRS / min(asyncio.run(_turns()))
    yield "superdense coding, physical layer, every noise on", f"{rate:,.0f} pairs/s"


async def _turns() -> list[float]:
    """Return how long each block of PAIRS took; one more goes before, so that memory is there."""
    layer = build_layer(_config(), JumpingClock(), None)
    paths = [Connection(in_port=here, out_port=there) for here, there in PATHS.items()]
    await Switching(layer).cross_connect("q1", paths)
    paulis = np.random.default_rng(1).integers(0, 4, PAIRS, dtype=np.uint8).tobytes()
    await _send_dibits(layer, 0, paulis)
    seconds = []
    for block in range(1, TURNS + 1):
        began = time.perf_counter()
        await _send_dibits(layer, block, paulis)
        seconds.append(time.perf_counter() - began)
    return seconds


async def _send_dibits(layer: PhysicalLayer, block: int, paulis: bytes) -> None:
    """Bring a dibit a pair from alice to bob."""
    errors: list[BaseException] = []
    operations, transport = Operations(layer), Transport(layer, errors.append)
    first, second = (BlockName(1, block, half) for half in (0, 1))
    operations.create("charlie", CreateRequest(session=1, number=block, count=PAIRS))
    await transport.send("charlie", [(first, "charlie-q0"), (second, "charlie-q1")], RATE_HZ)
    await transport.receive("alice", first, "alice-q0", DEADLINE_S)
    operations.apply("alice", first, paulis, [])
    await transport.send("alice", [(first, "alice-q0")], RATE_HZ)
    await transport.receive("bob", first, "bob-q0", DEADLINE_S)
    await transport.receive("bob", second, "bob-q1", DEADLINE_S)
    Measurements(layer).bell_measure("bob", (first, second))
    if errors:
        raise errors[0]


def _config() -> DispatcherConfig:
    fibers = [
        Fiber(FiberEnd(port.split("-")[0], port), FiberEnd("q1", str(number)), **NOISY_FIBER)
        for port, number in PORTS.items()
    ]
    return DispatcherConfig(
        listen="",
        socket="",
        seed=1,
        tokens={name: name for name in ("alice", "bob", "charlie", "q1")},
        fibers=fibers,
        switches=[QuantumSwitch("q1")],
        devices=NOISY_DEVICES,
    )
