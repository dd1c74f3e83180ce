"""The light of sources, against closed forms within 5 standard errors; the seed is 1."""

import numpy as np
import pytest
from five_sigma import within
from test_detectors import COUNT, NoDraws

from dispatcher.devices.source import Emission, emit, pair_probabilities
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.draws import Draws
from wire.parameters.physics import PairSource


def emission(source: PairSource) -> Emission:
    """Return what a source emits in COUNT pulses."""
    return emit(source, PhotonRandom(Draws(1), (7, 0, 0), "source", COUNT))


def test_an_ideal_source_draws_nothing() -> None:
    nothing = PhotonRandom(NoDraws(), (7, 0, 0), "source", COUNT)
    assert emit(PairSource(), nothing) == Emission(None, None, None)


@pytest.mark.parametrize("fidelity", [0.25, 0.9, 0.999])
def test_a_werner_source_emits_the_other_bell_states_alike(fidelity: float) -> None:
    emitted = emission(PairSource(fidelity=fidelity))
    assert emitted.exact
    assert emitted.paulis is not None
    counts = np.bincount(emitted.paulis, minlength=4)
    assert within(int(counts[0]), COUNT, fidelity)
    assert all(within(int(count), COUNT, (1 - fidelity) / 3) for count in counts[1:])


def test_a_bell_diagonal_source_emits_each_state_with_its_probability() -> None:
    probabilities = (0.7, 0.2, 0.0, 0.1)
    paulis = emission(PairSource(bell_diagonal=probabilities)).paulis
    assert paulis is not None
    counts = np.bincount(paulis, minlength=4).tolist()
    assert all(within(n, COUNT, p) for n, p in zip(counts, probabilities, strict=True))


@pytest.mark.parametrize("mean", [0.05, 1.0, 4.0])
@pytest.mark.parametrize("statistics", ["poisson", "thermal"])
def test_pairs_in_a_pulse_are_counted_by_the_statistics(statistics: str, mean: float) -> None:
    """Variance: the mean if Poisson, mean + mean^2 if thermal."""
    emitted = emission(PairSource(statistics=statistics, mean_pairs=mean))
    assert emitted.exact == (statistics == "poisson")
    assert emitted.pairs is not None
    pairs = emitted.pairs.astype(float)
    variance = mean if statistics == "poisson" else mean + mean**2
    assert abs(pairs.mean() - mean) < 5 * (variance / COUNT) ** 0.5
    fourth = ((pairs - mean) ** 4).mean()
    assert abs(pairs.var() - variance) < 5 * ((fourth - variance**2) / COUNT) ** 0.5
    none = np.exp(-mean) if statistics == "poisson" else 1 / (1 + mean)
    assert within(int((pairs == 0).sum()), COUNT, none)


@pytest.mark.parametrize("statistics", ["poisson", "thermal"])
def test_few_pulses_have_more_pairs_than_are_counted(statistics: str) -> None:
    assert pair_probabilities(statistics, 10.0).sum() == pytest.approx(1.0, abs=1e-10)


def test_a_source_without_pairs_emits_none() -> None:
    pairs = emission(PairSource(statistics="poisson", mean_pairs=0.0)).pairs
    assert pairs is not None
    assert not pairs.any()


def test_pairs_leave_with_the_jitter() -> None:
    delays_ps = emission(PairSource(jitter_ps=50.0)).delays_ps
    assert delays_ps is not None
    assert abs(delays_ps.mean()) < 5 * 50 / COUNT**0.5
    assert abs(delays_ps.std() - 50) < 5 * 50 / (2 * COUNT) ** 0.5
