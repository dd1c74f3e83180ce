"""Pairs a second of superdense coding in the physical layer alone, without a network around it.

    charlie-q0 --1 q1 3-- alice-q0
    charlie-q1 --2 q1 4-- bob-q0
                   q1 5-- bob-q1

Pairs are made at charlie and sent, half to alice and half to bob; alice encodes and sends on; bob
makes Bell measurements. Every photon passes the switch, as in `qmn run sdc`.
"""

import asyncio
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from dispatcher.layer.ownership import BlockName
from dispatcher.sabot.backend import Bytes
from evidence.laboratory import SESSION, Laboratory
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import BellAnalyser, Detectors, Device, PairSource

ENDS = {"charlie-q0": 1, "charlie-q1": 2, "alice-q0": 3, "bob-q0": 4, "bob-q1": 5}
WAYS = {1: 3, 2: 4, 3: 5}
HOSTS = ("alice", "bob", "charlie")
RATE_HZ = 50_000_000
BLOCK_PAIRS = 262_144  # the largest that `qmn run` takes
BLOCKS = 20
SEED = 1

NOISY_FIBER = FiberOptics(
    kind="smf",
    length_km=1.0,
    loss_db_per_km=0.2,
    connectors_db=0.1,
    depolarizing=0.005,
    dephasing=0.005,
    phase_drift_rad_per_sqrt_km=0.1,
    burst_depolarizing=0.2,
    burst_start_hz=100.0,
    burst_end_hz=10_000.0,
    temperature_slope_k_per_s=0.001,
    temperature_walk_k_per_sqrt_s=0.001,
    classical_mw=0.1,
)
TURNING_FIBER = FiberOptics(
    length_km=1.0, loss_db_per_km=1.0, polarization_drift_rad_per_sqrt_km=0.5
)
TIME_BINS = Device(source=PairSource(encoding="time-bin"), detectors=Detectors(encoding="time-bin"))
NOISY_DEVICE = Device(
    source=PairSource(
        statistics="poisson", mean_pairs=0.5, fidelity=0.98, jitter_ps=20.0, encoding="time-bin"
    ),
    detectors=Detectors(
        efficiency=0.9,
        dark_count_hz=100.0,
        dead_time_s=50e-9,
        afterpulse_probability=0.01,
        jitter_ps=20.0,
        encoding="time-bin",
    ),
    analyser=BellAnalyser(visibility=0.98, bandwidth_rad_per_s=1e10),
)
NOISY_SWITCH = QuantumSwitch("q1", insertion_loss_db=0.5)


@dataclass(frozen=True)
class Case:
    """A network to be measured: all fibres and all hosts' devices alike."""

    name: str
    fiber: FiberOptics = field(default_factory=FiberOptics)
    device: Device = field(default_factory=Device)
    switch: QuantumSwitch = field(default_factory=lambda: QuantumSwitch("q1"))

    def configuration(self) -> DispatcherConfig:
        fibers = [
            Fiber.joining(
                FiberEnd(port.partition("-")[0], port), FiberEnd("q1", str(number)), self.fiber
            )
            for port, number in ENDS.items()
        ]
        devices = dict.fromkeys(HOSTS, self.device)
        tokens = dict.fromkeys(HOSTS, "")  # nobody calls
        return DispatcherConfig("", "", SEED, tokens, fibers, [self.switch], devices=devices)


CASES = (
    Case("physical layer, ideal"),
    Case("  loss and depolarising", FiberOptics(loss_db_per_km=20.0, depolarizing=0.01)),
    Case("  polarisation turned", TURNING_FIBER),
    Case("  every noise of fibres", NOISY_FIBER, TIME_BINS),
    Case("  every noise on", NOISY_FIBER, NOISY_DEVICE, NOISY_SWITCH),
    Case(
        "  the same and crosstalk",
        NOISY_FIBER,
        NOISY_DEVICE,
        replace(NOISY_SWITCH, crosstalk_db=40.0),
    ),
)


def physical_layer_benchmarks() -> Iterator[tuple[str, str]]:
    for case in CASES:
        pairs_per_s = asyncio.run(speed(case))
        yield case.name, f"{pairs_per_s / 1e6:.1f} million Bell pairs/s, blocks of {BLOCK_PAIRS:,}"


async def speed(case: Case, blocks: int = BLOCKS) -> float:
    """Return the pairs a second of the fastest of several blocks: other programs take turns, too.

    One more block goes before, which allocates memory.
    """
    scene = Scene(case)
    await scene.begin()
    await scene.block()
    scene.discard()
    times_s = []
    for _ in range(blocks):
        started = time.perf_counter()
        await scene.block()
        times_s.append(time.perf_counter() - started)
        scene.discard()
    return BLOCK_PAIRS / min(times_s)


class Scene:
    """Superdense coding, block after block."""

    def __init__(self, case: Case) -> None:
        self._laboratory = Laboratory(case.configuration())
        self.dibits = np.random.default_rng(SEED).integers(0, 4, BLOCK_PAIRS, dtype=np.uint8)
        self._number = 0

    async def begin(self) -> None:
        await self._laboratory.connect("q1", WAYS)

    async def block(self) -> Bytes:
        """Send one block from alice to bob; return the Bell states that bob sees."""
        alice, bob, charlie = map(self._laboratory.host, HOSTS)
        first, second = ((self._number, half) for half in (0, 1))
        await charlie.create(BLOCK_PAIRS, self._number)
        await charlie.send({first: "charlie-q0", second: "charlie-q1"}, RATE_HZ)
        await alice.receive(first, "alice-q0")
        await bob.receive(second, "bob-q0")
        await alice.apply(first, self.dibits)
        await alice.send({first: "alice-q0"}, RATE_HZ)
        await bob.receive(first, "bob-q1")
        self._number += 1
        return await bob.bell_measure(first, second)

    def discard(self) -> None:
        """Drop what of the last block has strayed to ports where nobody waits for it."""
        layer = self._laboratory.layer
        for half in (0, 1):
            for part in layer.ownership.parts(BlockName(SESSION, self._number - 1, half)):
                layer.drop(part)
