"""Noise of fibres and detectors, and light of others, in heralds."""

from dataclasses import replace
from math import erf, exp, log1p, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from five_sigma import within
from heralding_scene import (
    DOUBLE,
    LITTLE,
    M_PER_S,
    SCHEMES,
    SINGLE,
    STATION,
    chance_of,
    correlations,
    enumerated,
    heralded,
    in_fock_space,
    of_little_light,
    scene,
)

from dispatcher.approximations import CLASSICAL_LIGHT, READY_STATION, STRAYED
from dispatcher.devices.heralding import Arm
from evidence.laboratory import Laboratory
from wire.config import BadConfig, QuantumSwitch
from wire.parameters.physics import BellAnalyser, Detectors, Device, Emitter, PairSource


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
    """Werner pairs: each basis errs with 2 (1 - F) / 3, fibres with p / 2 each, on two."""
    fidelity, p, count = 0.94, 0.02, 60_000
    device = Device(emitter=Emitter("two-click", fidelity=fidelity))
    keeps = (1 - 4 * (1 - fidelity) / 3) ** 2 * (1 - p) ** 2

    async def act(laboratory: Laboratory) -> None:
        bell_states, _attempts, _took_s = await heralded(laboratory, count)
        for found, of in (await correlations(laboratory, bell_states)).values():
            assert within(found, of, (1 + keeps) / 2)

    scene(act, device, depolarizing=p)


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
