"""A link whose hosts attempt to make pairs, its heralds simulated in Fock space."""

from collections import defaultdict
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import replace
from itertools import product
from math import cos, factorial, prod, sin, sqrt
from types import MappingProxyType
from typing import Any

import numpy as np
import uvloop
from numpy.typing import NDArray

from dispatcher.devices.heralding import KINDS, Arm, Heralds, phase_wrong, single_click, two_click
from evidence.laboratory import Laboratory, block_id
from wire.config import DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import BellOutcomes
from wire.parameters.physics import BellAnalyser, Device, Emitter, Memory

FIRST, SECOND = 60_001, 60_002  # the inputs of the analyser of a switch
PORTS = {"alice": "alice-q0", "bob": "bob-q0"}
M_PER_S = 2.04e8  # of light in fibre, as docs/fibers.md has it
STATION = Device(memory=Memory(capacity=0), analyser=BellAnalyser("linear"))
PSI = {1: np.array([0, 1, 1, 0]) / sqrt(2), 3: np.array([0, 1, -1, 0]) / sqrt(2)}

Modes = tuple[str, ...]
State = dict[tuple[int, int, Modes], complex]


def emitted(scheme: str, alpha: float, photon: int, host: int) -> list[tuple[int, str, float]]:
    """Return what a qubit and its photon are in: the qubit, the photon's mode, the amplitude."""
    del photon
    if scheme == "two-click":
        return [(0, f"{host}early", sqrt(0.5)), (1, f"{host}late", sqrt(0.5))]
    return [(0, "", sqrt(1 - alpha)), (1, f"{host}early", sqrt(alpha))]


def split(mode: str, efficiency: float, visibility: float) -> list[tuple[str, float]]:
    """Return where a photon goes: out of either side of the beam splitter, or into the fibre."""
    host, when = int(mode[0]), mode[1:]
    angle = np.arccos(sqrt(visibility)) if host else 0.0
    sign = -1.0 if host else 1.0
    ways = [(f"lost {mode}", sqrt(1 - efficiency))]
    for colour, overlap in (("red", cos(angle)), ("blue", sin(angle))):
        ways.append((f"c {when} {colour}", sqrt(efficiency / 2) * overlap))
        ways.append((f"d {when} {colour}", sqrt(efficiency / 2) * overlap * sign))
    return ways


def clicks(modes: Modes, bins: list[str], dark: float) -> dict[int, float]:
    """Return how likely photons in these modes are heralded as Psi+ (1) or Psi- (3)."""
    bell_states: dict[int, float] = defaultdict(float)
    for pattern in product("cd", repeat=len(bins)):  # the one that clicks in each bin
        chance = 1.0
        for when, clicking in zip(bins, pattern, strict=True):
            for side in "cd":
                light = any(mode.startswith(f"{side} {when}") for mode in modes)
                fires = 1.0 if light else dark
                chance *= fires if side == clicking else 1 - fires
        same = len(set(pattern)) == 1 if len(bins) > 1 else pattern == ("c",)
        bell_states[1 if same else 3] += chance
    return bell_states


def in_fock_space(
    scheme: str, arms: tuple[Arm, Arm], dark: float, visibility: float
) -> dict[int, NDArray[np.complex128]]:
    """Return the qubits' state behind either herald, its trace the herald's probability."""
    amplitudes: dict[tuple[int, Modes], complex] = defaultdict(complex)
    starts = [emitted(scheme, arm.bright_state, 1, host) for host, arm in enumerate(arms)]
    for (one, mode_a, first), (other, mode_b, second) in product(*starts):
        ways = [
            split(mode, arms[int(mode[0])].efficiency, visibility)
            for mode in (mode_a, mode_b)
            if mode
        ]
        for taken in product(*ways):
            modes = tuple(sorted(mode for mode, _amplitude in taken))
            number = prod(factorial(modes.count(mode)) for mode in set(modes))
            amplitude = first * second * prod(amplitude for _mode, amplitude in taken)
            amplitudes[2 * one + other, modes] += amplitude * sqrt(number)
    states = {1: np.zeros((4, 4), complex), 3: np.zeros((4, 4), complex)}
    bins = ["early", "late"] if scheme == "two-click" else ["early"]
    for modes in {modes for _qubits, modes in amplitudes}:
        vector = np.array([amplitudes.get((qubits, modes), 0.0) for qubits in range(4)])
        for bell_states, chance in clicks(modes, bins, dark).items():
            states[bell_states] += chance * np.outer(vector, vector.conj())
    return states


SCHEMES = {"two-click": two_click, "single-click": single_click}


def one_click(photons: int, dark: float, visibility: float) -> float:
    """Return how likely exactly one of two detectors clicks, with photons in their mode."""
    lit = {0: {(0, 0): 1.0}, 1: {(1, 0): 1.0}}.get(photons)
    lit = lit or {(1, 0): (1 + visibility) / 2, (1, 1): (1 - visibility) / 2}
    chance = 0.0
    for (light, likely), darks in product(lit.items(), product((0, 1), repeat=2)):
        if sum(map(max, light, darks)) == 1:
            chance += likely * prod(dark if each else 1 - dark for each in darks)
    return chance


def enumerated(scheme: str, arms: tuple[Arm, Arm], dark: float, visibility: float) -> list[float]:
    """Return the chances by KINDS, by which qubits have emitted what and whose light arrives."""
    chances, single = dict.fromkeys(KINDS, 0.0), scheme == "single-click"
    for bits, arrive in product(product((0, 1), repeat=2), repeat=2):
        chance = 1.0
        for arm, bit, there in zip(arms, bits, arrive, strict=True):
            bright = arm.bright_state if single else 0.5
            seen = arm.efficiency if bit or not single else 0.0
            chance *= (bright if bit else 1 - bright) * (seen if there else 1 - seen)
        for mode in (1,) if single else (0, 1):
            photons = sum(there for bit, there in zip(bits, arrive, strict=True) if bit == mode)
            chance *= one_click(photons, dark, visibility)
        entangled = sum(bits) == 1 and sum(arrive) == (1 if single else 2)
        chances["entangled" if entangled else f"{bits[0]}{bits[1]}"] += chance
    return list(chances.values())


def fidelity(scheme: str, heralds: Heralds, visibility: float, right: bool) -> float:
    """Return how like the heralded Bell state, or its opposite, pairs are."""
    entangled, _00, one, other, _11 = heralds.chances
    wrong = float(phase_wrong(scheme, heralds, visibility))
    kept = 1 - wrong if right else wrong
    return (entangled * kept + (one + other) / 2) / heralds.probability


def scene(
    act: Callable[[Laboratory], Awaitable[None]],
    device: Device,
    station: Device = STATION,
    km: tuple[float, float] = (10.0, 10.0),
    switch: QuantumSwitch = QuantumSwitch("q1"),  # noqa: B008 - immutable
    own: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    **fiber: Any,
) -> None:
    """Do something where alice and bob attempt with such a device, at q1, which is a station.

    `own` is of the fibre of one host, `fiber` of all.
    """
    fibers = [
        Fiber(
            FiberEnd(host, port),
            FiberEnd("q1", str(number)),
            length_km=length_km,
            **fiber,
            **own.get(host, {}),
        )
        for number, ((host, port), length_km) in enumerate(zip(PORTS.items(), km, strict=True), 1)
    ]
    devices = dict.fromkeys(PORTS, device)
    analyser, detectors = station.analyser, station.detectors
    switches = [replace(switch, analysers=1, analyser=analyser, detectors=detectors)]
    config = DispatcherConfig(
        "", "", 1, dict.fromkeys(devices, ""), fibers, switches, devices=devices
    )

    async def inside() -> None:
        laboratory = Laboratory(config)
        await laboratory.connect("q1", {1: FIRST, 2: SECOND})
        await laboratory.wait(1e-3)
        await act(laboratory)

    uvloop.run(inside())


async def heralded(
    laboratory: Laboratory, count: int, timeout_s: float = 60.0
) -> tuple[NDArray[np.uint8], int, float]:
    """Herald pairs; return the Bell states, the attempts, and how long it took."""
    found, took_s = await laboratory.heralded("q1", PORTS, count, timeout_s=timeout_s)
    assert found.end == BellOutcomes.HERALDED
    return np.frombuffer(found.outcomes, np.uint8), found.attempts, took_s


async def correlations(
    laboratory: Laboratory, bell_states: NDArray[np.uint8]
) -> dict[str, tuple[int, int]]:
    """Return how often outcomes are those of the heralded pairs, by basis, and of how many."""
    alice, bob = laboratory.host("alice"), laboratory.host("bob")
    size, right = bell_states.size, {}
    bases = (np.arange(size) % 3).astype(np.uint8)
    mine = await alice.measure((0, 0), bases=bases)
    yours = await bob.measure((0, 1), bases=bases)
    phase = (bell_states == 3).astype(np.uint8)  # of Psi+: equal in X and in Y, not in Z
    for number, basis in enumerate("ZXY"):
        at = bases == number
        differ = np.ones(size, np.uint8) if basis == "Z" else phase
        right[basis] = int(np.count_nonzero((mine ^ yours ^ differ)[at] == 0)), int(at.sum())
    return right


SINGLE, DOUBLE = "single-click", "two-click"
LITTLE = 0.01  # light of an emission: that two photons come is left out of closed forms below


def of_little_light(scheme: str, alpha: float = 0.1, **more: Any) -> Device:
    """Return a device whose attempts are heralded with 2 alpha eta, or eta^2 / 2."""
    return Device(emitter=Emitter(scheme, LITTLE, alpha, modes=1000), **more)


def chance_of(scheme: str, each: float = 1.0, alpha: float = 0.1) -> float:
    """Return how likely an attempt is heralded whose photons come with `each` of their chance."""
    light = LITTLE * each
    return 2 * alpha * light * (1 - alpha * light / 2) if scheme == SINGLE else light**2 / 2


async def attempted(laboratory: Laboratory, host: str, **more: Any) -> None:
    """Let a host attempt by its first port."""
    name = block_id((0, int(host == "bob")))
    wanted = {"block": name, "port": PORTS[host], "count": 1, **more}
    await laboratory.table.handle(host, "attempt", laboratory.request("attempt", **wanted))
