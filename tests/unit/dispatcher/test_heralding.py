"""Heralded pairs beside closed forms and a simulation in Fock space; 5 standard errors, seed 1."""

import asyncio
from collections import defaultdict
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import replace
from itertools import product
from math import cos, erf, exp, expm1, factorial, log1p, prod, sin, sqrt
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
import uvloop
from five_sigma import within
from limits import SOON_S
from numpy.typing import NDArray

from dispatcher.approximations import CLASSICAL_LIGHT, READY_STATION, STRAYED
from dispatcher.devices.heralding import (
    KINDS,
    Arm,
    Heralds,
    phase_wrong,
    single_click,
    two_click,
)
from dispatcher.laboratory import SESSION, Laboratory, LaboratoryHost
from dispatcher.layer.news_delays import NewsDelays
from dispatcher.layer.ownership import BlockName
from dispatcher.refusal import Refusal
from wire.config import BadConfig, DispatcherConfig, Fiber, FiberEnd, QuantumSwitch
from wire.dispatcher_pb2 import DiscardRequest, MeasureRequest
from wire.parameters.physics import (
    BellAnalyser,
    Detectors,
    Device,
    Emitter,
    Memory,
    PairSource,
)

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
CASES = [
    (Arm(1.0), Arm(1.0), 0.0, 1.0),
    (Arm(0.3), Arm(0.3), 0.0, 0.9),
    (Arm(0.3), Arm(0.05), 0.002, 0.7),
    (Arm(0.2, 0.1), Arm(0.2, 0.1), 0.01, 0.8),
    (Arm(0.2, 0.1), Arm(0.1, 0.2), 0.01, 0.8),
]


@pytest.mark.parametrize("scheme", list(SCHEMES))
@pytest.mark.parametrize(("first", "second", "dark", "visibility"), CASES)
def test_heralds_are_those_of_a_simulation_in_fock_space(
    scheme: str, first: Arm, second: Arm, dark: float, visibility: float
) -> None:
    arms = first, second
    heralds = SCHEMES[scheme](arms, dark, visibility)
    states = in_fock_space(scheme, arms, dark, visibility)
    for bell_states, state in states.items():
        assert np.trace(state).real == pytest.approx(heralds.probability / 2, rel=1e-12)
        ours = [fidelity(scheme, heralds, visibility, right) for right in (True, False)]
        theirs = [(PSI[bell] @ state @ PSI[bell]).real for bell in (bell_states, bell_states ^ 2)]
        theirs = [each / np.trace(state).real for each in theirs]
        assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-12)
        for kind in ("00", "11"):
            at = int(kind, 2)
            chance = heralds.chances[KINDS.index(kind)] / 2
            assert state[at, at].real == pytest.approx(chance, rel=1e-9, abs=1e-15)


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


@pytest.mark.parametrize("scheme", list(SCHEMES))
@pytest.mark.parametrize(
    ("first", "second", "dark", "visibility"),
    [
        (Arm(0.9, 0.1), Arm(0.3, 0.4), 0.05, 0.8),
        (Arm(0.3, 0.4), Arm(0.9, 0.1), 0.05, 0.8),
        (Arm(0.5, 0.3), Arm(0.5, 0.1), 0.02, 1.0),
        (Arm(0.5, 0.3), Arm(0.1, 0.3), 0.02, 0.0),
    ],
)
def test_all_chances_of_unlike_hosts_are_those_of_an_enumeration(
    scheme: str, first: Arm, second: Arm, dark: float, visibility: float
) -> None:
    heralds = SCHEMES[scheme]((first, second), dark, visibility)
    expected = enumerated(scheme, (first, second), dark, visibility)
    assert heralds.chances == pytest.approx(expected, rel=1e-12)


def fidelity(scheme: str, heralds: Heralds, visibility: float, right: bool) -> float:
    """Return how like the heralded Bell state, or its opposite, pairs are."""
    entangled, _00, one, other, _11 = heralds.chances
    wrong = float(phase_wrong(scheme, heralds, visibility))
    kept = 1 - wrong if right else wrong
    return (entangled * kept + (one + other) / 2) / heralds.probability


def test_the_closed_forms_of_both_schemes() -> None:
    # Barrett and Kok: eta^2 / 2. Single click: 2 alpha eta, and 1 - alpha, of little light.
    assert two_click((Arm(0.3), Arm(0.3)), 0.0, 1.0).probability == pytest.approx(0.045)
    little = single_click((Arm(1e-6, 0.1), Arm(1e-6, 0.1)), 0.0, 1.0)
    assert little.probability == pytest.approx(2 * 0.1 * 1e-6, rel=1e-5)
    assert fidelity("single-click", little, 1.0, True) == pytest.approx(0.9, rel=1e-5)
    drifting = single_click((Arm(1e-6, 1e-9, 0.2), Arm(1e-6, 1e-9, 0.2)), 0.0, 1.0)
    coherence = exp(-0.04)  # of a phase with the variance 2 x 0.2^2
    assert fidelity("single-click", drifting, 1.0, True) == pytest.approx((1 + coherence) / 2)


def scene(
    act: Callable[[Laboratory], Awaitable[None]],
    device: Device,
    station: Device = STATION,
    km: tuple[float, float] = (10.0, 10.0),
    switch: QuantumSwitch = QuantumSwitch("q1"),  # noqa: B008 - immutable
    own: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    **fiber: Any,
) -> None:
    """Do something where alice and bob attempt with such a device, by way of q1, at charlie.

    `own` is of the fibre of one host, `fiber` of all.
    """
    lengths = {"alice": km[0], "bob": km[1], "charlie": 0.0}
    ends = [("alice", "alice-q0"), ("bob", "bob-q0"), ("charlie", "charlie-q0")]
    ends.append(("charlie", "charlie-q1"))
    fibers = [
        Fiber(
            FiberEnd(host, port),
            FiberEnd("q1", str(number)),
            length_km=lengths[host],
            **fiber,
            **own.get(host, {}),
        )
        for number, (host, port) in enumerate(ends, 1)
    ]
    devices = {"alice": device, "bob": device, "charlie": station}
    config = DispatcherConfig(
        "", "", 1, dict.fromkeys(devices, ""), fibers, [switch], devices=devices
    )

    async def inside() -> None:
        laboratory = Laboratory(config)
        await laboratory.connect("q1", {1: 3, 2: 4})
        await laboratory.wait(1e-3)
        await act(laboratory)

    uvloop.run(inside())


async def heralded(
    laboratory: Laboratory, count: int, timeout_s: float = 60.0
) -> tuple[NDArray[np.uint8], int, float]:
    """Herald pairs; return the Bell states, the attempts, and how long it took."""
    await laboratory.host("alice").attempt((0, 0), "alice-q0")
    await laboratory.host("bob").attempt((0, 1), "bob-q0")
    station = laboratory.host("charlie")
    found = await station.herald(count, ("charlie-q0", "charlie-q1"), timeout_s)
    bell_states = np.frombuffer(found.outcomes, np.uint8)
    return bell_states, found.attempts, (found.last_ns - found.first_ns) / 1e9


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


def test_a_link_makes_p_pairs_in_each_round_trip_to_the_station() -> None:
    """p c / 2L: .045 of 20 km of fibre there and back."""
    device = Device(emitter=Emitter("two-click", efficiency=0.3))

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, took_s = await heralded(laboratory, 3000)
        assert bell_states.size == 3000
        assert within(bell_states.size, attempts, 0.045)
        assert within(int(np.count_nonzero(bell_states == 1)), bell_states.size, 0.5)
        assert took_s / attempts == pytest.approx(2 * 10_000 / M_PER_S, rel=1e-3)
        right = await correlations(laboratory, bell_states)
        assert all(found == of for found, of in right.values())

    scene(act, device)


def test_modes_attempt_side_by_side() -> None:
    device = Device(emitter=Emitter("two-click", efficiency=0.3, modes=100))

    async def act(laboratory: Laboratory) -> None:
        _told, attempts, took_s = await heralded(laboratory, 3000)
        assert within(3000, attempts, 0.045)
        assert took_s / attempts == pytest.approx(2 * 10_000 / M_PER_S / 100, rel=1e-2)

    scene(act, device)


def test_the_longer_way_and_the_preparation_pace_attempts() -> None:
    device = Device(emitter=Emitter("two-click", preparation_s=1e-3))

    async def act(laboratory: Laboratory) -> None:
        _told, attempts, took_s = await heralded(laboratory, 1000)
        assert took_s / attempts == pytest.approx(1e-3 + 2 * 15_000 / M_PER_S, rel=1e-3)

    scene(act, device, km=(15.0, 5.0))


def test_fibres_detectors_and_switches_lose_light_of_attempts() -> None:
    device = Device(emitter=Emitter("two-click", efficiency=0.5))
    station = Device(detectors=Detectors(efficiency=0.8), analyser=BellAnalyser("linear"))
    efficiency = 0.5 * 0.8 * 10 ** (-2.0 / 10)  # of 10 km with .2 dB each

    async def act(laboratory: Laboratory) -> None:
        _told, attempts, _took_s = await heralded(laboratory, 3000)
        assert within(3000, attempts, efficiency**2 / 2)
        counted = laboratory.layer.network.switches["q1"].ports
        assert within(counted[1].photons_in, attempts, 0.5 * 10 ** (-2.0 / 10))
        assert counted[3].photons_out == counted[1].photons_in

    scene(act, device, station, loss_db_per_km=0.2)


def test_single_clicks_are_common_and_1_minus_alpha_is_their_fidelity() -> None:
    alpha, efficiency, count = 0.2, 0.01, 60_000
    device = Device(emitter=Emitter("single-click", efficiency, alpha, modes=100))
    state = in_fock_space("single-click", (Arm(efficiency, alpha),) * 2, 0.0, 1.0)[1]
    bright = state[3, 3].real / np.trace(state).real  # both have emitted

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, count)
        assert within(count, attempts, 2 * np.trace(state).real)
        right = await correlations(laboratory, bell_states)
        assert within(*right["Z"], 1 - bright)
        assert within(*right["X"], 1 - bright / 2)
        assert within(*right["Y"], 1 - bright / 2)
        assert 1 - bright == pytest.approx(1 - alpha, rel=1e-2)

    scene(act, device)


@pytest.mark.parametrize("scheme", list(SCHEMES))
def test_dark_counts_herald_pairs_that_are_none(scheme: str) -> None:
    dark_hz, gate_s, count = 1e6, 1e-8, 60_000
    device = Device(emitter=Emitter(scheme, 0.05, 0.1, modes=100))
    detectors = Detectors(dark_count_hz=dark_hz, gate_s=gate_s)
    station = Device(detectors=detectors, analyser=BellAnalyser("linear", visibility=0.8))
    dark = 1 - exp(-dark_hz * gate_s)
    states = in_fock_space(scheme, (Arm(0.05, 0.1),) * 2, dark, 0.8)
    chance = np.trace(states[1] + states[3]).real
    state = (states[1] + np.diag([1, 1, -1, -1]) @ states[3] @ np.diag([1, 1, -1, -1])) / chance

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, count)
        assert within(count, attempts, chance)
        right = await correlations(laboratory, bell_states)
        assert within(*right["Z"], (state[1, 1] + state[2, 2]).real)
        assert within(*right["X"], (1 + 2 * (state[1, 2] + state[0, 3]).real) / 2)
        assert within(*right["Y"], (1 + 2 * (state[1, 2] - state[0, 3]).real) / 2)

    scene(act, device, station)


def test_bits_of_unlike_hosts_are_their_own() -> None:
    """Outcomes in Z, (0, 0) to (1, 1), where a tenth of alice's light comes.

    By the enumeration; entangled ones are Bell states, an approximation where arms are unequal.
    """
    count, dark, gate_s = 60_000, 0.03, 1e-8
    device = Device(emitter=Emitter("single-click", 0.9, 0.3, modes=100))
    detectors = Detectors(dark_count_hz=-log1p(-dark) / gate_s, gate_s=gate_s)
    station = Device(detectors=detectors, analyser=BellAnalyser("linear"))
    arms = Arm(0.09, 0.3), Arm(0.9, 0.3)
    entangled, *rest = enumerated("single-click", arms, dark, 1.0)
    likely = np.array(rest) + entangled * np.array([0, 0.5, 0.5, 0])

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, count)
        assert within(count, attempts, likely.sum())
        bits = [
            await laboratory.host(host).measure((0, half))
            for half, host in enumerate(("alice", "bob"))
        ]
        found = np.bincount(2 * bits[0] + bits[1], minlength=4)
        for number, chance in zip(found, likely / likely.sum(), strict=True):
            assert within(int(number), bell_states.size, float(chance))

    scene(act, device, station, own={"alice": {"loss_db_per_km": 1.0}})


@pytest.mark.parametrize("scheme", list(SCHEMES))
def test_clicks_that_are_told_of_the_other_detector_flip_phases(scheme: str) -> None:
    """One of one click with e, one of two with 2 e (1 - e); Z does not see it."""
    alpha, efficiency, error, count = 0.2, 0.01, 0.1, 40_000
    device = Device(emitter=Emitter(scheme, efficiency, alpha, modes=1000))
    station = Device(detectors=Detectors(readout_error=error), analyser=BellAnalyser("linear"))
    state = in_fock_space(scheme, (Arm(efficiency, alpha),) * 2, 0.0, 1.0)[1]
    psi = 1 - state[3, 3].real / np.trace(state).real
    keeps = 1 - 2 * error if scheme == "single-click" else 1 - 4 * error * (1 - error)

    async def act(laboratory: Laboratory) -> None:
        bell_states, _attempts, _took_s = await heralded(laboratory, count)
        right = await correlations(laboratory, bell_states)
        assert within(*right["Z"], psi)
        assert within(*right["X"], (1 + psi * keeps) / 2)
        assert within(*right["Y"], (1 + psi * keeps) / 2)

    scene(act, device, station)


def test_noise_of_fibres_and_of_emitters_is_in_the_pairs() -> None:
    """Werner pairs: each basis errs with 2 (1 - F) / 3, fibres with p / 2 each, on four."""
    fidelity, p, count = 0.94, 0.02, 60_000
    device = Device(emitter=Emitter("two-click", fidelity=fidelity))
    keeps = (1 - 4 * (1 - fidelity) / 3) ** 2 * (1 - p) ** 4

    async def act(laboratory: Laboratory) -> None:
        bell_states, _attempts, _took_s = await heralded(laboratory, count)
        for found, of in (await correlations(laboratory, bell_states)).values():
            assert within(found, of, (1 + keeps) / 2)

    scene(act, device, depolarizing=p)


SINGLE, DOUBLE = "single-click", "two-click"
LITTLE = 0.01  # light of an emission: that two photons come is left out of closed forms below


def of_little_light(scheme: str, alpha: float = 0.1, **more: Any) -> Device:
    """Return a device whose attempts are heralded with 2 alpha eta, or eta^2 / 2."""
    return Device(emitter=Emitter(scheme, LITTLE, alpha, modes=1000), **more)


def chance_of(scheme: str, each: float = 1.0, alpha: float = 0.1) -> float:
    """Return how likely an attempt is heralded whose photons come with `each` of their chance."""
    light = LITTLE * each
    return 2 * alpha * light * (1 - alpha * light / 2) if scheme == SINGLE else light**2 / 2


@pytest.mark.parametrize("scheme", list(SCHEMES))
def test_scattered_classical_light_heralds_pairs_that_are_none(scheme: str) -> None:
    """Of mean mu at the station mu/2 come to either side, of two clicks half of it to each mode."""
    km, joule = 10.0, 6.62607015e-34 * 299_792_458 / 1550.12e-9
    mu = 1e-3 * 2e-9 * km * 0.4 * 1e-9 / joule  # 1 mW, as parameters of fibres are by default
    dark = 1 - exp(-mu / 2 if scheme == SINGLE else -mu / 4)
    chance = 2 * dark * (1 - dark)
    chance **= 1 if scheme == SINGLE else 2
    device = Device(emitter=Emitter(scheme, 0.0, 0.0, modes=1000))

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, 20_000)
        assert within(bell_states.size, attempts, chance)
        right = await correlations(laboratory, bell_states)
        zeros = 0.0 if scheme == SINGLE else 0.5  # of qubits that are both in |0>, or in any state
        assert within(*right["Z"], zeros)
        assert within(*right["X"], 0.5)
        # No emission has clicked: of all heralds none is a pair.
        assert laboratory.layer.approximations.sizes == {CLASSICAL_LIGHT: pytest.approx(1.0)}

    scene(act, device, own={"alice": {"classical_mw": 1.0}})


@pytest.mark.parametrize("scheme", list(SCHEMES))
def test_detectors_that_are_unlike_tell_one_state_less_often(scheme: str) -> None:
    """One has 1 - m of the other's efficiency: the mean of both clicks, the lesser for Psi-."""
    mismatch, count = 0.5, 20_000
    less = 1 - mismatch
    minus = less / (1 + less) if scheme == SINGLE else 2 * less / (1 + less) ** 2
    detectors = Detectors(efficiency_mismatch=mismatch)

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, count)
        assert within(bell_states.size, attempts, chance_of(scheme, (1 + less) / 2))
        assert within(int(np.count_nonzero(bell_states == 3)), bell_states.size, minus)
        right = await correlations(laboratory, bell_states)
        assert within(*right["X"], 0.95 if scheme == SINGLE else 1.0)

    scene(act, of_little_light(scheme), Device(detectors=detectors, analyser=STATION.analyser))


SOME = """import numpy as np
from dispatcher.fiber.noise import Effect


class Some:
    def __init__(self, lost=0.0, flipped=0.0, extras=False):
        self.lost, self.flipped, self.extras = lost, flipped, extras

    def effect(self, passage):
        return Effect(
            lost=passage.happens("lost", self.lost),
            paulis=passage.happens("flipped", self.flipped) * np.uint8(2),
            extras=np.ones(passage.photons, np.uint8) if self.extras else None,
        )
"""


@pytest.mark.parametrize("scheme", list(SCHEMES))
def test_a_click_of_one_photon_needs_that_one_alone(scheme: str, tmp_path: Path) -> None:
    """A model of one's own loses .4 of either host's light: .6 of single clicks are left."""
    (tmp_path / "some.py").write_text(SOME)
    own: Any = {"noise": f"{tmp_path}/some.py:Some", "noise_parameters": {"lost": 0.4}}

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, 20_000)
        assert within(bell_states.size, attempts, chance_of(scheme, 0.6))

    scene(act, of_little_light(scheme), own={"alice": own, "bob": own})


def test_what_a_model_of_one_s_own_adds_to_light_of_attempts_is_refused(tmp_path: Path) -> None:
    (tmp_path / "some.py").write_text(SOME)
    own: Any = {"noise": f"{tmp_path}/some.py:Some", "noise_parameters": {"extras": True}}

    async def act(laboratory: Laboratory) -> None:
        with pytest.raises(BadConfig, match=r"extras of noise in the fibre to 1 of q1: light of"):
            await heralded(laboratory, 10)

    scene(act, of_little_light(DOUBLE), **own)


@pytest.mark.parametrize("scheme", list(SCHEMES))
@pytest.mark.parametrize("what", ["detectors", "source", "dispersion"])
def test_light_that_comes_outside_the_gate_is_no_herald(scheme: str, what: str) -> None:
    """Of an rms error of 100 ps erf(1/2 / sqrt 2) come within a gate of 100 ps."""
    inside = erf(0.5 / sqrt(2))
    detectors = Detectors(gate_s=1e-10, jitter_ps=100.0 if what == "detectors" else 0.0)
    source = PairSource(
        jitter_ps=100.0 if what == "source" else 0.0,
        bandwidth_nm=0.5 if what == "dispersion" else 0.0,
    )
    fiber: dict[str, Any] = {"dispersion_ps_per_nm_km": 20.0} if what == "dispersion" else {}

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, 20_000)
        assert within(bell_states.size, attempts, chance_of(scheme, inside))

    device = of_little_light(scheme, source=source)
    scene(act, device, Device(detectors=detectors, analyser=STATION.analyser), **fiber)


def test_clicks_that_are_too_far_apart_are_no_coincidence() -> None:
    """The difference of two jitters of 100 ps is within a window of 100 ps."""
    detectors = Detectors(gate_s=1e-8, jitter_ps=100.0)
    analyser = BellAnalyser("linear", coincidence_window_s=1e-10)

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, 20_000)
        assert within(bell_states.size, attempts, chance_of(DOUBLE) * erf(1 / sqrt(2) / sqrt(2)))

    scene(act, of_little_light(DOUBLE), Device(detectors=detectors, analyser=analyser))


def test_noise_of_one_s_own_of_a_station_s_detectors_is_in_its_heralds(tmp_path: Path) -> None:
    """Of .3 nothing is heralded, and of .1 the other phase."""
    (tmp_path / "some.py").write_text(SOME)
    parameters = {"lost": 0.3, "flipped": 0.1}
    detectors = Detectors(noise=f"{tmp_path}/some.py:Some", noise_parameters=parameters)

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, 20_000)
        assert within(bell_states.size, attempts, 0.7 * chance_of(DOUBLE))
        right = await correlations(laboratory, bell_states)
        assert within(*right["Z"], 1.0)
        assert within(*right["X"], 0.9)
        assert within(*right["Y"], 0.9)

    scene(act, of_little_light(DOUBLE), Device(detectors=detectors, analyser=STATION.analyser))


@pytest.mark.parametrize(
    ("scheme", "detectors", "modes", "share"),
    [
        # The detector sees alpha eta of all modes: these clicks are in the time of two rounds.
        (SINGLE, Detectors(dead_time_s=2.5 * 2 * 10_000 / M_PER_S), 1, 2 * 0.1 * LITTLE),
        (SINGLE, Detectors(dead_time_s=1e-8), 1, None),  # over when the next attempt is
        (SINGLE, Detectors(dead_time_s=1e-8), 100, 100 * 0.1 * LITTLE),
        (DOUBLE, Detectors(afterpulse_probability=0.02), 1, 0.02),
        (DOUBLE, Detectors(dead_time_s=1e-8), 1, None),  # polarisations have detectors of their own
    ],
)
def test_a_result_says_what_dead_times_of_a_station_would_decide(
    scheme: str, detectors: Detectors, modes: int, share: float | None
) -> None:
    device = Device(emitter=Emitter(scheme, LITTLE, 0.1, modes=modes))

    async def act(laboratory: Laboratory) -> None:
        await heralded(laboratory, 3)
        found = laboratory.layer.approximations.sizes.get(READY_STATION)
        assert found == (None if share is None else pytest.approx(share))
        assert laboratory.layer.exact == (share is None)

    scene(act, device, Device(detectors=detectors, analyser=STATION.analyser))


def test_a_result_says_how_much_light_of_attempts_would_stray() -> None:
    """10^(-20 / 10) in the one switch on the way."""

    async def act(laboratory: Laboratory) -> None:
        await heralded(laboratory, 3)
        assert laboratory.layer.approximations.sizes == {STRAYED: pytest.approx(0.01)}

    scene(act, of_little_light(DOUBLE), switch=QuantumSwitch("q1", crosstalk_db=20.0))


@pytest.mark.parametrize("count", [1, 4000])
def test_a_station_reports_when_hardly_any_light_comes_in_its_gate(count: int) -> None:
    """Two clicks with a jitter of 1 ms in gates of 1 ns: (1e-9 / 1e-3)^2 / 2 pi of the attempts."""

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, _took_s = await heralded(laboratory, count)
        assert bell_states.size == 0
        assert 0 < attempts < 3_000_000

    station = replace(STATION, detectors=Detectors(jitter_ps=1e9))
    scene(act, Device(emitter=Emitter("two-click")), station)


LATE = """import numpy as np
from dispatcher.fiber.noise import Effect


class Late:
    def __init__(self, ps):
        self.ps = ps

    def effect(self, passage):
        return Effect(delays_ps=np.full(passage.photons, self.ps))
"""


@pytest.mark.parametrize("scheme", list(SCHEMES))
def test_light_of_one_arm_that_comes_late_tells_where_it_came_from(
    scheme: str, tmp_path: Path
) -> None:
    """V exp(-(s tau)^2) is left of the interference at a mismatch tau (Hong, Ou, Mandel)."""
    rad_per_s, mismatch, best, count = 1e11, 0.7, 0.9, 60_000
    (tmp_path / "late.py").write_text(LATE)
    alices, bobs = 20.0, 20.0 + mismatch / rad_per_s * 1e12
    own = {
        host: {"noise": f"{tmp_path}/late.py:Late", "noise_parameters": {"ps": ps}}
        for host, ps in (("alice", alices), ("bob", bobs))
    }
    device = Device(emitter=Emitter(scheme, 0.05, 0.1, modes=100))
    analyser = BellAnalyser("linear", visibility=best, bandwidth_rad_per_s=rad_per_s)
    arms = (Arm(0.05, 0.1),) * 2
    # Late light is other light to the phase of a pair only: how many click together does not move.
    states = in_fock_space(scheme, arms, 0.0, best * exp(-(mismatch**2)))
    chance = np.trace(states[1] + states[3]).real
    state = (states[1] + np.diag([1, 1, -1, -1]) @ states[3] @ np.diag([1, 1, -1, -1])) / chance

    async def act(laboratory: Laboratory) -> None:
        bell_states, _attempts, _took_s = await heralded(laboratory, count)
        right = await correlations(laboratory, bell_states)
        assert within(*right["X"], (1 + 2 * (state[1, 2] + state[0, 3]).real) / 2)
        assert within(*right["Y"], (1 + 2 * (state[1, 2] - state[0, 3]).real) / 2)

    scene(act, device, Device(analyser=analyser), own=own)


def test_light_of_attempts_meets_no_kraus_operators() -> None:
    """Their effect on heralds is not modelled: refused, not left out."""

    async def act(laboratory: Laboratory) -> None:
        with pytest.raises(BadConfig, match=r"fibre to 1 of q1: light of heralded attempts cannot"):
            await heralded(laboratory, 10)

    damping = str(Path(__file__).parents[3] / "docs" / "noise-models" / "damping.py") + ":Damping"
    own: dict[str, Any] = {"noise": damping, "noise_parameters": {"gamma": 0.1}}
    scene(act, Device(emitter=Emitter("two-click")), **own)


def test_each_qubit_waits_from_its_own_emission() -> None:
    """With T2 the phase is kept with the mean of exp(-2 t / T2) over all times."""
    t2_s, count, efficiency = 3.0, 3000, 0.3
    device = Device(
        memory=Memory(t1_s=1e6, t2_s=t2_s), emitter=Emitter("two-click", efficiency=efficiency)
    )

    async def act(laboratory: Laboratory) -> None:
        bell_states, _attempts, took_s = await heralded(laboratory, count)
        right = await correlations(laboratory, bell_states)
        assert right["Z"][0] == right["Z"][1]
        # Heralds come evenly in time: both qubits have waited anything up to all of it.
        mean = -expm1(-2 * took_s / t2_s) / (2 * took_s / t2_s)
        assert mean < 0.3
        for basis in "XY":
            assert within(*right[basis], (1 + mean) / 2)

    scene(act, device)


def test_no_more_is_heralded_than_time_allows() -> None:
    device = Device(emitter=Emitter("two-click", efficiency=0.01))

    async def act(laboratory: Laboratory) -> None:
        bell_states, attempts, took_s = await heralded(laboratory, 3000, timeout_s=2.0)
        assert took_s == pytest.approx(2.0, rel=1e-3)
        assert attempts == pytest.approx(2.0 / (2 * 10_000 / M_PER_S), rel=1e-3)
        assert within(bell_states.size, attempts, 0.01**2 / 2)

    scene(act, device)


def test_light_that_a_switch_let_go_while_it_came_is_no_herald() -> None:
    device = Device(emitter=Emitter("two-click", efficiency=0.3))

    async def act(laboratory: Laboratory) -> None:
        start_ns = laboratory.clock.now_ns()
        closes_ns = start_ns + 100_000_000
        wait = laboratory.clock.wait_until

        async def closing(time_ns: int) -> None:
            if time_ns > closes_ns > laboratory.clock.time_ns:
                laboratory.clock.time_ns = closes_ns
                await laboratory.connect("q1", {1: 3})
            await wait(time_ns)

        laboratory.clock.wait_until = closing  # type: ignore[method-assign]
        bell_states, attempts, _took_s = await heralded(laboratory, 3000, timeout_s=1.0)
        assert within(bell_states.size, attempts // 10, 0.045)

    scene(act, device)


def attempts_of(host: LaboratoryHost) -> Awaitable[object]:
    """Let a host attempt by its first port."""
    return host.attempt((0, int(host.name == "bob")), f"{host.name}-q0")


def test_what_cannot_be_heralded_is_refused() -> None:
    device = Device(memory=Memory(capacity=10), emitter=Emitter("two-click"))

    async def act(laboratory: Laboratory) -> None:
        alice, bob, charlie = (laboratory.host(name) for name in ("alice", "bob", "charlie"))
        ports = ("charlie-q0", "charlie-q1")
        with pytest.raises(Refusal, match="feature HERALD is needed: charlie has no qubits"):
            await charlie.attempt((0, 0), "charlie-q0")
        with pytest.raises(Refusal, match="no node attempts for block 0/0"):
            await charlie.herald(5, ports, 1.0)
        await attempts_of(alice)
        await attempts_of(bob)
        with pytest.raises(Refusal, match="comes to charlie-q0 of charlie, not to charlie-q1"):
            await charlie.herald(5, ports[::-1], 1.0)
        with pytest.raises(Refusal, match="11 more qubits with 0 stored exceed the capacity"):
            await charlie.herald(11, ports, 1.0)
        await laboratory.connect("q1", {1: 3})
        with pytest.raises(Refusal, match="bob-q0 of bob comes out nowhere"):
            await charlie.herald(5, ports, 1.0)
        assert laboratory.layer.sabot.live_qubits == 0

    scene(act, device)


def test_light_of_who_attempts_under_the_name_of_another_is_not_taken_for_its_light() -> None:
    device = Device(memory=Memory(capacity=10), emitter=Emitter("two-click"))

    async def act(laboratory: Laboratory) -> None:
        await laboratory.host("bob").attempt((0, 0), "bob-q0")
        bell_states, _attempts, _seconds = await heralded(laboratory, 3)
        assert bell_states.size == 3
        assert (await laboratory.host("alice").measure((0, 0))).size == 3

    scene(act, device)


def test_a_station_hears_of_a_path_that_is_not_there_when_news_can_be_here() -> None:
    """Copper of alice, who is farthest, takes 7 ms to a switch, and charlie's 3 ms from there."""
    device = Device(memory=Memory(capacity=10), emitter=Emitter("two-click"))
    copper_s = {"alice": 7e-3, "bob": 1e-3, "charlie": 3e-3}
    news_s = {name: {"s1": delay_s} for name, delay_s in copper_s.items()} | {"s1": copper_s}

    async def act(laboratory: Laboratory) -> None:
        laboratory.layer.news = NewsDelays(news_s)
        await attempts_of(laboratory.host("alice"))
        await attempts_of(laboratory.host("bob"))
        await laboratory.connect("q1", {1: 3})
        asked_ns = laboratory.clock.now_ns()
        with pytest.raises(Refusal, match="bob-q0 of bob comes out nowhere"):
            await laboratory.host("charlie").herald(5, ("charlie-q0", "charlie-q1"), 1.0)
        assert laboratory.clock.now_ns() == asked_ns + 10_000_000 + 1

    scene(act, device)


@pytest.mark.parametrize("copper_s", [None, 20e-6, 90e-6])
def test_no_host_finds_a_heralded_pair_before_news_of_it_can_be_there(
    copper_s: float | None,
) -> None:
    """10 km of fibre take 49.02 us; copper that is shorter may bring it sooner, no other."""
    device = Device(memory=Memory(capacity=10), emitter=Emitter("two-click"))
    news_ns = round(min(10_000 / M_PER_S, copper_s or 1.0) * 1e9)

    async def act(laboratory: Laboratory) -> None:
        if copper_s is not None:
            laboratory.layer.news = NewsDelays({"alice": {"charlie": copper_s}})
        layer, clock = laboratory.layer, laboratory.clock
        bell_states, jump = asyncio.Event(), clock.wait_until

        async def wait(time_ns: int) -> None:
            if asyncio.current_task() is not station:
                await bell_states.wait()
            await jump(time_ns)

        clock.wait_until = wait  # type: ignore[method-assign]
        station = asyncio.create_task(heralded(laboratory, 3))
        with layer.history.watching("alice", 0, remembered=False) as watcher:
            async with asyncio.timeout(SOON_S):
                while "alice" not in layer.memories._stored:
                    await asyncio.sleep(0)
            clicked_ns, alice = clock.now_ns(), laboratory.host("alice")
            name, nowhere = BlockName(SESSION, 0, 0), BlockName(SESSION, 99, 0)
            for later_ns in (0, news_ns - 2):
                clock.time_ns = clicked_ns + later_ns
                words = set()
                for each in (name, nowhere):
                    with pytest.raises(Refusal) as refused:
                        layer.ownership.require(each, "alice")
                    words.add(str(refused.value).replace(str(each), ""))
                assert len(words) == 1
                assert not layer.ownership.of_session("alice", SESSION)
            while not watcher.idle:
                assert (await watcher.next()).kind == "attempt"
            clock.time_ns = clicked_ns + news_ns
            bell_states.set()
            assert (await alice.measure((0, 0))).size == 3
            await station
            assert "heralded" in [each.kind for each in await watcher.some()]

    scene(act, device)


def test_a_pair_that_nobody_wants_any_more_when_it_is_heard_of_is_let_go() -> None:
    device = Device(memory=Memory(capacity=10), emitter=Emitter("two-click"))

    async def act(laboratory: Laboratory) -> None:
        request = DiscardRequest(session=SESSION)
        station = asyncio.create_task(heralded(laboratory, 3))
        while "alice" not in laboratory.layer.memories._stored:
            await asyncio.sleep(0)
        await laboratory.table.handle("alice", "discard", request)
        await station
        assert not laboratory.layer.ownership.at_node("alice")
        assert len(laboratory.layer.ownership.at_node("bob")) == 1
        assert laboratory.layer.sabot.live_qubits == 3

    scene(act, device)


def test_hosts_of_different_schemes_are_refused_and_a_gate_is_no_station() -> None:
    async def act(laboratory: Laboratory) -> None:
        await attempts_of(laboratory.host("alice"))
        await attempts_of(laboratory.host("bob"))
        with pytest.raises(Refusal, match="feature INTERFERE is needed: charlie has no analyser"):
            await laboratory.host("charlie").herald(5, ("charlie-q0", "charlie-q1"), 1.0)

    scene(act, Device(emitter=Emitter("two-click")), Device(analyser=BellAnalyser("gates")))


def test_bases_of_measurements_are_as_numbered() -> None:
    assert (MeasureRequest.Z, MeasureRequest.X, MeasureRequest.Y) == (0, 1, 2)
