"""The estimate of fidelity from sacrificed pairs: by hand, and against its own confidence."""

import numpy as np
import pytest

from hosts.middleware.services.distribution.fidelity import Estimate
from hosts.middleware.session.values import Lifetimes

Z, X, Y = 0, 1, 2
NO_CLICK = 3
PAULI = {Z: np.diag([1, -1]), X: np.array([[0, 1], [1, 0]]), Y: np.array([[0, -1j], [1j, 0]])}


def estimate(bases: list[int], ours: list[int], theirs: list[int]) -> Estimate:
    """Return what these outcomes say."""
    found = Estimate()
    found.add(*(np.array(column, dtype=np.uint8) for column in (bases, ours, theirs)))
    return found


@pytest.mark.parametrize(
    ("right_in", "fidelity"),
    [({Z, X, Y}, 1.0), ({Z, Y}, 0.5), ({Z}, 0.0), (set(), 0.0)],
)
def test_outcomes_as_of_a_bell_state(right_in: set[int], fidelity: float) -> None:
    """Phi+; half Phi+ and half Phi-, which only X tells apart; Psi+ and worse."""
    bases = [Z, X, Y] * 4
    theirs = [(basis == Y) == (basis in right_in) for basis in bases]
    assert estimate(bases, [0] * 12, [int(bit) for bit in theirs]).fidelity == fidelity


def test_it_is_that_of_the_mean_correlations() -> None:
    bases = [Z] * 10 + [X] * 10 + [Y] * 10
    wrong = [int(letter) for letter in "100000000011000000000001111111"]
    # <ZZ> = .8, <XX> = .6, <YY> = -.4
    assert estimate(bases, [0] * 30, wrong).fidelity == pytest.approx((1 + 0.6 + 0.4 + 0.8) / 4)


def test_pairs_without_a_click_do_not_count() -> None:
    found = estimate([Z, X, Y, Z, X], [0, 0, 0, NO_CLICK, 1], [0, 0, 1, 1, NO_CLICK])
    assert (found.total, found.fidelity) == (3, 1.0)


def test_nothing_is_known_while_a_basis_has_no_outcome() -> None:
    found = estimate([Z, X], [0, 0], [0, 0])
    assert found.fidelity is None
    assert found.interval is None


def test_a_perfect_sample_does_not_prove_perfection() -> None:
    low, high = estimate([Z, X, Y] * 100, [0] * 300, [0, 0, 1] * 100).interval or (0.0, 0.0)
    # Wilson's interval of 300 of 300 begins at 1 / (1 + 1.96^2 / 300) = .98736.
    assert low == pytest.approx((3 * 0.98736 - 1) / 2, abs=1e-4)
    assert high == 1


@pytest.mark.parametrize("fidelity", [0.5, 0.8, 0.95])
def test_the_interval_holds_the_truth_in_95_of_100_samples(fidelity: float) -> None:
    """4000 samples of 300 Werner pairs each; seed 1.

    Counts have steps, so that a Wilson interval holds between 93 and 97 of 100 (Brown, Cai and
    DasGupta, Stat. Sci. 16, 101).
    """
    random, samples, held = np.random.default_rng(1), 4000, 0
    right = (1 + (4 * fidelity - 1) / 3) / 2
    for _ in range(samples):
        found = Estimate(np.full(3, 100), random.binomial(100, right, 3))
        low, high = found.interval or (0.0, 0.0)
        held += low <= fidelity <= high
    assert 0.93 < held / samples < 0.97


def test_the_interval_is_safe_where_one_basis_has_all_errors() -> None:
    """4000 samples of 300 pairs that are dephased by half; seed 2."""
    random, samples, held = np.random.default_rng(2), 4000, 0
    for _ in range(samples):
        right = random.binomial(100, [1.0, 0.5, 0.5])
        low, high = Estimate(np.full(3, 100), right).interval or (0.0, 0.0)
        held += low <= 0.5 <= high
    assert held / samples > 0.95


def waited(state: np.ndarray, half: int, t1_s: float, t2_s: float, time_s: float) -> np.ndarray:
    """Return a density matrix of two qubits one of which has been damped and dephased."""
    gone = 1 - np.exp(-time_s / t1_s)
    flip = (1 - np.exp(time_s / (2 * t1_s) - time_s / t2_s)) / 2
    damping = [np.diag([1, np.sqrt(1 - gone)]), np.array([[0, np.sqrt(gone)], [0, 0]])]
    for kraus in (damping, [np.sqrt(1 - flip) * np.eye(2), np.sqrt(flip) * PAULI[Z]]):
        both = [np.kron(*((each, np.eye(2)) if half == 0 else (np.eye(2), each))) for each in kraus]
        state = np.sum([each @ state @ each.conj().T for each in both], axis=0)
    return state


@pytest.mark.parametrize("time_s", [0.0, 0.1, 0.7])
def test_what_waits_on_decays_as_its_density_matrix(time_s: float) -> None:
    """<ZZ> = .8, <XX> = .6, <YY> = -.4; T1 and T2 of 1 and .5 s, and of 2 and 3 s."""
    wrong = [int(letter) for letter in "100000000011000000000001111111"]
    found = estimate([Z] * 10 + [X] * 10 + [Y] * 10, [0] * 30, wrong)
    terms = [(PAULI[Z], 0.8), (PAULI[X], 0.6), (PAULI[Y], -0.4)]
    state = sum((c * np.kron(p, p) for p, c in terms), start=np.eye(4, dtype=complex)) / 4
    for half, (t1_s, t2_s) in enumerate(((1.0, 0.5), (2.0, 3.0))):
        state = waited(state, half, t1_s, t2_s, time_s)
    phi = np.array([1, 0, 0, 1]) / np.sqrt(2)
    never = float("inf")
    report = found.after(
        time_s, (Lifetimes(1.0, 0.5, never, never), Lifetimes(2.0, 3.0, never, never))
    )
    assert report == pytest.approx((phi @ state @ phi).real)


def test_nothing_is_expected_of_pairs_that_nobody_has_measured() -> None:
    assert Estimate().after(1.0, (Lifetimes(1.0, 1.0, 1.0, 1.0),) * 2) is None


def test_a_plain_depolarising_memory_makes_werner_pairs() -> None:
    """Of Phi+ there is e^(-t/s - t/s') left, and a quarter of the rest."""
    found = estimate([Z] * 10 + [X] * 10 + [Y] * 10, [0] * 30, [0] * 20 + [1] * 10)
    never = float("inf")
    report = found.after(
        0.3, (Lifetimes(never, never, 1.0, never), Lifetimes(never, never, 2.0, never))
    )
    left = np.exp(-0.3 - 0.15)
    assert report == pytest.approx(left + (1 - left) / 4)
