"""Every setting of devices, fibres and switches acts: at an extreme an outcome changes.

Each case is a job in the laboratory that should feel the setting, and others that it depends on.
Times, refusals and approximations count as feedback. Other tests check the size of each effect.
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, fields, replace
from math import pi
from typing import Any

import numpy as np
import pytest
import uvloop
from heralding_scene import FIRST, SECOND
from heralding_scene import PORTS as HERALDED

from dispatcher.fiber.noise import Effect, Passage
from dispatcher.refusal import Refusal
from evidence.laboratory import START_NS, Laboratory
from wire.config import BadConfig, DispatcherConfig, Fiber, FiberEnd
from wire.dispatcher_pb2 import CreateRequest, Feedback, Gate, MeasureRequest
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import BellAnalyser, Compensator, Device
from wire.parameters.switch import PathOptics, QuantumSwitch

COUNT = 600
PORTS = {1: "alice-q0", 2: "alice-q1", 3: "bob-q0", 4: "bob-q1", 5: "charlie-q0", 6: "charlie-q1"}
Z_OR_X = MeasureRequest.Z, MeasureRequest.X
LIGHT = "rate_hz", "frequency_mhz"  # of send
LONGER = "charlie-q1"  # whose fibre is the longer one, if ways are to be unequal
MODEL = f"{__file__}:Flip"
ELSEWHERE = {  # settings that no single job of hosts feels, and what tries them
    "fiber.kind": "a name for values of others: tests/unit/topologies",
    "fiber.channel_crosstalk_db": "of light in other channels: test_channels.py",
    **dict.fromkeys(
        ("switch.analysers", "switch.analyser", "switch.detectors", "switch.gates"),
        "of a switch that measures: test_switch_analysers.py",
    ),
    **dict.fromkeys(
        ("switch.memories", "switch.memory", "switch.sources", "switch.source"),
        "of a switch that stores and emits: test_switch_memories.py",
    ),
    "switch.emitter": "of memories that emit: test_stations.py",
    **dict.fromkeys(
        ("detectors.clock_offset_s", "detectors.clock_skew_ppm", "detectors.clock_jitter_ps"),
        "of time tags: tests/unit/applications/test_time_tags.py",
    ),
    "switch.min_power_dbm": "bounds what a port is tuned to: test_switch_requests.py",
}


class Flip:
    """A noise model of a user's own."""

    def __init__(self, flip: float = 0.5) -> None:
        """Flip so often."""
        self.flip = flip

    def effect(self, passage: Passage) -> Effect:
        """Flip bits and phases."""
        return Effect(paulis=passage.happens("flip", self.flip) * np.uint8(3))


@dataclass
class Job:
    """A laboratory, and the feedback to its hosts."""

    laboratory: Laboratory
    light: dict[str, Any]  # of send
    feedback: list[object] = field(default_factory=list)

    def note(self, feedback: Feedback | None) -> None:
        """Keep all feedback to a host: when, whether that is exact, and outcomes."""
        self.feedback.append(str(feedback))

    async def send(self, host: str, launches: dict[tuple[int, int], str]) -> None:
        """Send light of this rate and colour."""
        self.note(await self.laboratory.host(host).send(launches, **self.light))

    async def receive(self, host: str, block: tuple[int, int], port: str) -> bool:
        """Receive a block; return whether any of it has come."""
        feedback = await self.laboratory.host(host).receive(block, port)
        self.note(feedback)
        return feedback is not None

    async def measure(self, host: str, block: tuple[int, int], basis: int) -> None:
        """Measure a block in Z (0) or X (1)."""
        bits = await self.laboratory.host(host).measure(block, Z_OR_X[basis])
        self.feedback.append(bits.tobytes())
        self.feedback.append(self.laboratory.clock.now_ns() - START_NS)


async def prepared(job: Job) -> None:
    """Alice prepares |1> and |->, which bob measures as they come."""
    alice = job.laboratory.host("alice")
    await job.laboratory.connect("q1", {1: 3})
    for number, state in enumerate((1, 3)):
        decoys = job.laboratory.layer.devices.of("alice").source.decoys
        levels = None if decoys is None else np.ones(COUNT, np.uint8)
        await alice.prepare(np.full(COUNT, state, np.uint8), number, levels)
        await job.send("alice", {(number, 0): "alice-q0"})
        if await job.receive("bob", (number, 0), "bob-q0"):
            await job.measure("bob", (number, 0), state >> 1)


async def direct(job: Job) -> None:
    """Alice prepares |1>, which comes to bob by a fibre without a switch."""
    await job.laboratory.host("alice").prepare(np.ones(COUNT, np.uint8))
    await job.send("alice", {(0, 0): "alice-q2"})
    if await job.receive("bob", (0, 0), "bob-q2"):
        await job.measure("bob", (0, 0), 0)


async def stored(job: Job) -> None:
    """Charlie sends halves of pairs to alice and bob; he keeps his for a while."""
    await job.laboratory.connect("q1", {5: 1, 6: 3})
    bob = job.laboratory.host("bob")
    for number, basis in enumerate((0, 1)):
        await job.laboratory.host("charlie").create(COUNT, number)
        launches = {(number, 0): "charlie-q0", (number, 1): "charlie-q1"}
        await job.send("charlie", launches)
        if await job.receive("alice", (number, 0), "alice-q0"):
            await job.measure("alice", (number, 0), basis)
        if await job.receive("bob", (number, 1), "bob-q0"):
            job.note(await bob.store((number, 1)))
            await job.laboratory.wait(0.01)
            await job.measure("bob", (number, 1), basis)


async def joined(job: Job) -> None:
    """Charlie sends both halves of pairs to bob, who makes a Bell measurement."""
    await job.laboratory.connect("q1", {5: 3, 6: 4})
    await job.laboratory.host("charlie").create(COUNT)
    await job.send("charlie", {(0, 0): "charlie-q0", (0, 1): "charlie-q1"})
    for half in (0, 1):
        await job.receive("bob", (0, half), f"bob-q{half}")
    job.feedback.append((await job.laboratory.host("bob").bell_measure((0, 0), (0, 1))).tobytes())


async def program(job: Job) -> None:
    """Bob makes two qubits, entangles them and measures both."""
    bob = job.laboratory.host("bob")
    for number in (0, 1):
        job.note(await bob.create(COUNT, number, CreateRequest.ZEROS))
    target = {"session": 1, "number": 1, "half": 0}
    job.note(await bob.apply((0, 0), gates=[Gate(name=Gate.H), Gate(name=Gate.H)]))
    job.note(await bob.apply((0, 0), gates=[Gate(name=Gate.CX, target=target)]))
    for number in (0, 1):
        await job.measure("bob", (number, 0), 0)


async def heralded(job: Job) -> None:
    """A station in q1 heralds pairs of qubits of alice and bob."""
    await job.laboratory.connect("q1", {1: FIRST, 3: SECOND})
    report, took_s = await job.laboratory.heralded("q1", HERALDED, COUNT, timeout_s=1.0)
    job.feedback += [str(report), took_s]
    for half, host in enumerate(HERALDED):
        await job.measure(host, (0, half), 1)


async def sensed(job: Job) -> None:
    """Alice exposes |+> to her sensor, and measures it."""
    await job.laboratory.host("alice").prepare(np.full(COUNT, 2, np.uint8))
    job.note(await job.laboratory.host("alice").sense((0, 0)))
    await job.measure("alice", (0, 0), 1)


Act = Callable[[Job], Awaitable[None]]
Settings = dict[str, Any]
POISSON = {"alice.source.statistics": "poisson", "alice.source.mean_pairs": 0.5}
PAIRS = {"charlie.source.statistics": "poisson"}
LOSSY = {"fiber.connectors_db": 5.0}
UNEQUAL = {"unequal_km": 0.1, "bob.analyser.delay_line_km": 0.0}
IN_BINS = {"alice.source.encoding": "time-bin", "bob.detectors.encoding": "time-bin"}
DRIFT = {"fiber.polarization_drift_rad_per_sqrt_km": 30.0}
UNDONE = DRIFT | {"bob.compensator.retarders": 3}
FAST = {"fiber.polarization_drift_time_s": 0.01}
SLOW = UNDONE | {"bob.compensator.measuring_s": 1e-7}
WATCHED = SLOW | {"bob.compensator.reference": "error-rate"}
PHASE = IN_BINS | {"fiber.phase_drift_rad_per_sqrt_km": 30.0}
BAD = {"fiber.burst_depolarizing": 1.0, "fiber.burst_start_hz": 1e6}
WARM = {"rate_hz": 1000, "fiber.length_km": 1.0, "fiber.temperature_slope_k_per_s": 1.0}
RAMAN = {"fiber.classical_mw": 10.0, "fiber.length_km": 10.0, "fiber.loss_db_per_km": 0.2}
WIDE = {"alice.source.bandwidth_nm": 10.0, "fiber.length_km": 1.0}
CLICKS = {
    f"{host}.emitter.{name}": value
    for host in ("alice", "bob")
    for name, value in {"scheme": "single-click", "efficiency": 0.5}.items()
} | {"switch.analysers": 1, "switch.analyser": BellAnalyser("linear")}
OWN = "source.noise", "memory.noise", "gates.noise", "detectors.noise", "fiber.noise"
CASES: list[tuple[Act, str, Any, Settings]] = [
    (stored, "charlie.source.statistics", "poisson", {}),
    (stored, "charlie.source.mean_pairs", 0.1, PAIRS),
    (stored, "charlie.source.fidelity", 0.25, {}),
    (stored, "charlie.source.bell_diagonal", (0.0, 1.0, 0.0, 0.0), {}),
    (prepared, "alice.source.jitter_ps", 1e6, {}),
    (prepared, "alice.source.max_rate_hz", 1.0, {"alice.source.g2": 0.1}),
    (prepared, "alice.source.encoding", "time-bin", {}),
    (joined, "charlie.source.bandwidth_nm", 10.0, UNEQUAL),
    (heralded, "alice.source.bandwidth_nm", 10.0, CLICKS | {"alice.source.jitter_ps": 1e3}),
    (prepared, "alice.source.g2", 0.49, LOSSY),
    (prepared, "alice.source.preparation_error", 0.5, {}),
    (prepared, "alice.source.decoys", (0.1, 0.0), POISSON),
    (prepared, "alice.source.heralding_efficiency", 0.1, POISSON),
    (prepared, "alice.source.noise", MODEL, {}),
    (prepared, "alice.source.noise_parameters", {"flip": 0.0}, {"alice.source.noise": MODEL}),
    (stored, "bob.memory.t1_s", 1e-3, {"bob.memory.t2_s": 1e-3}),
    (stored, "bob.memory.t2_s", 1e-3, {}),
    (stored, "bob.memory.damping", "dense", {"bob.memory.t1_s": 1e-3, "bob.memory.t2_s": 2e-3}),
    (stored, "bob.memory.efficiency", 0.0, {}),
    (stored, "bob.memory.depolarizing_s", 1e-3, {}),
    (stored, "bob.memory.retrieval_s", 1e-3, {}),
    (stored, "bob.memory.herald_efficiency", 0.0, {}),
    (stored, "bob.memory.false_herald", 1.0, LOSSY),
    (stored, "bob.memory.kind", "emissive", {}),
    (stored, "bob.memory.cutoff_s", 1e-9, {}),
    (stored, "bob.memory.capacity", 0, {}),
    (stored, "bob.memory.noise", MODEL, {}),
    (stored, "bob.memory.noise_parameters", {"flip": 0.0}, {"bob.memory.noise": MODEL}),
    (program, "bob.gates.kind", "paulis", {}),
    (program, "bob.gates.one_qubit_depolarizing", 1.0, {}),
    (program, "bob.gates.two_qubit_depolarizing", 1.0, {}),
    (program, "bob.gates.one_qubit_s", 1.0, {}),
    (program, "bob.gates.two_qubit_s", 1.0, {}),
    (program, "bob.gates.initialization_s", 1.0, {}),
    (program, "bob.gates.readout_s", 1.0, {}),
    (program, "bob.gates.initialization_error", 0.5, {}),
    (program, "bob.gates.readout_error", 0.5, {}),
    (stored, "bob.gates.readout_error", 0.5, {}),
    (sensed, "alice.gates.readout_error", 0.5, {}),
    (program, "bob.gates.noise", MODEL, {}),
    (program, "bob.gates.noise_parameters", {"flip": 0.0}, {"bob.gates.noise": MODEL}),
    (prepared, "bob.detectors.efficiency", 0.0, {}),
    (prepared, "bob.detectors.dark_count_hz", 1e9, LOSSY),
    (prepared, "bob.detectors.gate_s", 1e-12, {"bob.detectors.jitter_ps": 100.0}),
    (prepared, "bob.detectors.dead_time_s", 1.0, {}),
    (prepared, "bob.detectors.afterpulse_probability", 1.0, LOSSY),
    (
        prepared,
        "bob.detectors.afterpulse_s",
        1e-3,
        LOSSY | {"bob.detectors.afterpulse_probability": 1.0},
    ),
    (prepared, "bob.detectors.jitter_ps", 1e6, {}),
    (prepared, "bob.detectors.encoding", "time-bin", {}),
    (prepared, "bob.detectors.efficiency_mismatch", 1.0, {}),
    (prepared, "bob.detectors.readout_error", 0.5, {}),
    (prepared, "bob.detectors.noise", MODEL, {}),
    (prepared, "bob.detectors.noise_parameters", {"flip": 0.0}, {"bob.detectors.noise": MODEL}),
    (joined, "bob.analyser.kind", "linear", {"charlie.source.fidelity": 0.5}),
    (joined, "bob.analyser.visibility", 0.0, {}),
    (joined, "bob.analyser.bandwidth_rad_per_s", 1e12, UNEQUAL),
    (joined, "bob.analyser.coincidence_window_s", 1e-12, UNEQUAL),
    (joined, "bob.analyser.delay_line_km", 0.0, {"unequal_km": 100.0}),
    (joined, "bob.analyser.delay_line_db_per_km", 100.0, {"unequal_km": 100.0}),
    (heralded, "alice.emitter.scheme", "none", CLICKS),
    (heralded, "alice.emitter.efficiency", 0.01, CLICKS),
    (heralded, "alice.emitter.bright_state", 0.9, CLICKS),
    (heralded, "alice.emitter.fidelity", 0.25, CLICKS),
    (heralded, "alice.emitter.phase_rad", 10.0, CLICKS),
    (heralded, "alice.emitter.preparation_s", 0.01, CLICKS),
    (heralded, "alice.emitter.modes", 100, CLICKS | {"bob.emitter.modes": 100}),
    (sensed, "alice.sensor.phase_rad", pi, {}),
    (prepared, "bob.compensator.retarders", 3, DRIFT),
    (prepared, "bob.compensator.range_rad", 0.1, UNDONE),
    (prepared, "bob.compensator.speed_rad_per_s", 1e-6, UNDONE),
    (prepared, "bob.compensator.insertion_loss_db", 20.0, UNDONE),
    (prepared, "bob.compensator.error_rad", 3.0, UNDONE),
    (prepared, "bob.compensator.every_s", 1e-3, UNDONE | {"rate_hz": 1000} | FAST),
    (prepared, "bob.compensator.reference", "interrupting", SLOW),
    (prepared, "bob.compensator.reference_share", 0.5, UNDONE),
    (prepared, "bob.compensator.measuring_s", 1.0, UNDONE),
    (prepared, "bob.compensator.error_limit", 1.0, WATCHED),
    (prepared, "fiber.birefringence", "compensated", DRIFT),
    (prepared, "fiber.length_km", 1000.0, {}),
    (prepared, "fiber.loss_db_per_km", 1000.0, {}),
    (prepared, "fiber.connectors_db", 20.0, {}),
    (prepared, "fiber.depolarizing", 1.0, {}),
    (prepared, "fiber.dephasing", 0.5, {}),
    (prepared, "fiber.pauli_x", 0.5, {}),
    (prepared, "fiber.pauli_y", 0.5, {}),
    (prepared, "fiber.pauli_z", 0.5, {}),
    (prepared, "fiber.polarization_drift_rad_per_sqrt_km", 100.0, {}),
    (prepared, "fiber.polarization_drift_time_s", 1e-9, DRIFT),
    (prepared, "fiber.pdl_db", 100.0, {}),
    (prepared, "fiber.pmd_ps_per_sqrt_km", 1000.0, WIDE),
    (prepared, "fiber.phase_drift_rad_per_sqrt_km", 100.0, IN_BINS),
    (prepared, "fiber.phase_drift_time_s", 1e-9, PHASE),
    (prepared, "fiber.dispersion_ps_per_nm_km", 1000.0, WIDE),
    (prepared, "fiber.burst_depolarizing", 1.0, {"fiber.burst_start_hz": 1e9}),
    (prepared, "fiber.burst_start_hz", 1e12, {"fiber.burst_depolarizing": 1.0}),
    (prepared, "fiber.burst_end_hz", 1e12, BAD | {"fiber.burst_start_hz": 1e9}),
    (prepared, "fiber.temperature_slope_k_per_s", 10.0, WARM),
    (prepared, "fiber.temperature_walk_k_per_sqrt_s", 10.0, WARM),
    (prepared, "fiber.thermal_ppm_per_k", 1000.0, WARM),
    (prepared, "fiber.classical_mw", 1000.0, RAMAN),
    (prepared, "fiber.classical_db_per_km", 100.0, RAMAN),
    (prepared, "fiber.classical_way", "against", RAMAN),
    (prepared, "fiber.raman_per_km_nm", 1e-6, RAMAN),
    (prepared, "fiber.filter_nm", 100.0, RAMAN),
    (prepared, "fiber.filter_center_nm", 5000.0, RAMAN),
    (prepared, "fiber.pulse_window_s", 1e-6, RAMAN),
    (direct, "fiber.channels", 2, {"frequency_mhz": 193_500_000}),
    (direct, "fiber.grid_ghz", 200.0, {"frequency_mhz": 193_460_000, "fiber.channels": 2}),
    (direct, "fiber.multiplexer_db", 20.0, {"fiber.channels": 2}),
    (prepared, "fiber.noise", MODEL, {}),
    (prepared, "fiber.noise_parameters", {"flip": 0.0}, {"fiber.noise": MODEL}),
    (prepared, "switch.switching_time_s", 1.0, {}),
    (prepared, "switch.insertion_loss_db", 20.0, {}),
    (prepared, "switch.rotation", 3, {}),
    (prepared, "switch.depolarizing", 1.0, {}),
    (prepared, "switch.paths", [PathOptics(1, 3, 20.0)], {}),
    (prepared, "switch.crosstalk_db", 3.0, {}),
    (prepared, "switch.temperature_c", 100.0, {}),
    (prepared, "switch.max_temperature_c", 0.0, {}),
    (prepared, "switch.hot_loss_db", 20.0, {"switch.temperature_c": 100.0}),
    (prepared, "switch.compensator", Compensator(3), DRIFT),
    (prepared, "switch.min_frequency_mhz", 195_000_000, {}),
    (prepared, "switch.max_frequency_mhz", 192_000_000, {}),
    (prepared, "switch.grid_mhz", 12_500, {"frequency_mhz": 193_420_000}),
]


def of(settings: Settings, place: str) -> Settings:
    """Return what settings say of a place, by the names that follow."""
    start = f"{place}."
    return {name[len(start) :]: v for name, v in settings.items() if name.startswith(start)}


def device(settings: Settings, host: str) -> Device:
    """Return the device of a host."""
    device = Device()
    for name, value in of(settings, host).items():
        part, _dot, which = name.partition(".")
        device = replace(device, **{part: replace(getattr(device, part), **{which: value})})
    return device


def feedback_of(act: Act, settings: Settings) -> list[object]:
    """Return the feedback to the hosts of a job, and the reason of its end."""
    optics = of(settings, "fiber")
    ways = [
        (FiberEnd(end.partition("-")[0], end), FiberEnd("q1", str(n))) for n, end in PORTS.items()
    ]
    ways.append((FiberEnd("alice", "alice-q2"), FiberEnd("bob", "bob-q2")))
    fibers = [Fiber(*way, **optics) for way in ways]
    if more_km := settings.get("unequal_km"):
        fibers = [
            replace(each, length_km=each.length_km + more_km * (LONGER in each.a.port))
            for each in fibers
        ]
    hosts = ("alice", "bob", "charlie")
    switches = [QuantumSwitch("q1", **of(settings, "switch"))]
    config = DispatcherConfig("", "", 1, dict.fromkeys(hosts, ""), fibers, switches)
    config.devices.update({host: device(settings, host) for host in hosts})
    light: Settings = {name: settings[name] for name in LIGHT if name in settings}
    found: list[object] = []

    async def run() -> None:
        try:
            job = Job(Laboratory(config), light, found)
            await act(job)
            found.append(dict(job.laboratory.layer.approximations.sizes))
        except (Refusal, BadConfig) as ends:
            found.append(str(ends))

    uvloop.run(run())
    return found


@pytest.mark.parametrize(
    ("act", "setting", "value", "beside"), CASES, ids=[f"{c[1]} {c[0].__name__}" for c in CASES]
)
def test_an_extreme_of_a_setting_changes_what_hosts_are_told(
    act: Act, setting: str, value: Any, beside: Settings
) -> None:
    assert feedback_of(act, beside) != feedback_of(act, beside | {setting: value})


def test_every_setting_is_tried_at_an_extreme() -> None:
    tried = {name.partition(".")[2] if name.count(".") == 2 else name for _, name, _, _ in CASES}
    parts: dict[str, Any] = {each.name: each.default for each in fields(Device)}
    settings = {f"{part}.{each.name}" for part, device in parts.items() for each in fields(device)}
    settings |= {f"fiber.{each.name}" for each in fields(FiberOptics)}
    settings |= {f"switch.{each.name}" for each in fields(QuantumSwitch) if each.name != "name"}
    assert settings - tried == set(ELSEWHERE)
