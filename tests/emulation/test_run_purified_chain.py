"""Nested purification in a chain of three repeaters, real components, beside papers' formulas."""

from pathlib import Path

import pytest
from test_run_nodes import polarised, require_estimate, result_of

FIDELITY = 0.92
Pair = tuple[float, float, float, float]  # of Phi+, Psi-, Psi+, Phi-: A, B, C and D of the papers


def purified(pair: Pair) -> Pair:
    """A round of Deutsch et al., Phys. Rev. Lett. 77, 2818 (1996), equation 3."""
    a, b, c, d = pair
    n = (a + b) ** 2 + (c + d) ** 2
    return (a**2 + b**2) / n, 2 * c * d / n, (c**2 + d**2) / n, 2 * a * b / n


def connected(pair: Pair) -> Pair:
    """Two pairs alike, by a Bell measurement in the middle: their Pauli errors multiply.

    Two that are the same leave Phi+, and two that differ the third, or the one that is not Phi+.
    """
    a, b, c, d = pair
    same = a**2 + b**2 + c**2 + d**2
    return same, 2 * (a * b + c * d), 2 * (a * c + b * d), 2 * (a * d + b * c)


def nested(rounds: int) -> float:
    """Two levels of Briegel et al., Phys. Rev. Lett. 81, 5932 (1998): purify, connect, repeat."""
    wrong = (1 - FIDELITY) / 3
    pair = (FIDELITY, wrong, wrong, wrong)
    for _level in range(2):
        for _round in range(rounds):
            pair = purified(pair)
        pair = connected(pair)
    return pair[0]


def test_the_papers_formulas_by_hand() -> None:
    """Without a round four Werner links: (1 + 3 ((4F - 1) / 3)^4) / 4 (Briegel et al., eq. 1)."""
    assert nested(0) == pytest.approx((1 + 3 * ((4 * FIDELITY - 1) / 3) ** 4) / 4)
    # Pairs of A = .7 and B = .3 alone: A^2 + B^2 over (A + B)^2, and 2 A B of what is D then.
    assert purified((0.7, 0.3, 0.0, 0.0)) == pytest.approx((0.58, 0.0, 0.0, 0.42))


@pytest.mark.nightly
@pytest.mark.parametrize("rounds", [1, 0])
def test_spans_are_purified_before_they_are_swapped(tmp_path: Path, rounds: int) -> None:
    words = ["swap", "--topology", "repeaters,3", "--purification", "none"]
    words += ["--schedule", "nested", "--purify", str(rounds)] if rounds else []
    words += ["--count", "200", "--sample", "0.8"]
    for host in ("alice", "r1", "r2", "r3"):
        words += ["--device", f"{host}.source.fidelity={FIDELITY}"]
    asking = result_of(tmp_path, *words)["job"]["asking"]
    assert asking["pairs"] == 200
    require_estimate(asking, polarised(nested(rounds)), 0.0)
