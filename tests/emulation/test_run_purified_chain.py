"""Nested purification in a chain of three switches, real components, beside papers' formulas."""

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
    assert in_order("parallel", rounds=0) == pytest.approx(nested(0))
    """Without a round four Werner links: (1 + 3 ((4F - 1) / 3)^4) / 4 (Briegel et al., eq. 1)."""
    assert nested(0) == pytest.approx((1 + 3 * ((4 * FIDELITY - 1) / 3) ** 4) / 4)
    # Pairs of A = .7 and B = .3 alone: A^2 + B^2 over (A + B)^2, and 2 A B of what is D then.
    assert purified((0.7, 0.3, 0.0, 0.0)) == pytest.approx((0.58, 0.0, 0.0, 0.42))


def in_order(schedule: str, rounds: int = 1) -> float:
    """Four links, purified, and what swaps make in this order, but for the last."""
    wrong = (1 - FIDELITY) / 3
    link: Pair = (FIDELITY, wrong, wrong, wrong)
    for _round in range(rounds):
        link = purified(link)
    pair = link
    for swap in range(3):
        pair = joined(pair, link)
        for _round in range(rounds if schedule == "left-to-right" and swap < 2 else 0):
            pair = purified(pair)
    return pair[0]


def joined(one: Pair, other: Pair) -> Pair:
    """Two pairs that differ: the Pauli errors of both, as two bits (X, Z), add up."""
    bits = 0, 3, 1, 2
    made = dict.fromkeys(bits, 0.0)
    for x, p in zip(bits, one, strict=True):
        for y, q in zip(bits, other, strict=True):
            made[x ^ y] += p * q
    return made[0], made[3], made[1], made[2]


SOURCES = [f"--switch=source.fidelity={FIDELITY}"]
SOURCES += [f"--device={host}.source.fidelity={FIDELITY}" for host in ("alice", "bob")]
IN_SWITCHES = ["swap", "--topology", "chain,3", "--purification", "none", "--purify", "1", *SOURCES]


@pytest.mark.by_day(every=4)
@pytest.mark.parametrize(
    ("schedule", "expected", "more"),
    [
        ("nested", nested(1), []),
        ("left-to-right", in_order("left-to-right"), []),
        ("parallel", in_order("parallel"), []),
        ("nested", nested(1), ["--length-km=10", "--loss-db-per-km=0.2", "--block-pairs=6000"]),
    ],
)
def test_switches_purify_spans_before_they_swap(
    tmp_path: Path, schedule: str, expected: float, more: list[str]
) -> None:
    words = [*IN_SWITCHES, "--schedule", schedule, "--count", "500", "--sample", "0.5", *more]
    asking = result_of(tmp_path, *words)["job"]["asking"]
    assert (asking["pairs"], asking["span_rounds"], asking["rounds"]) == (500, 1, 0)
    require_estimate(asking, polarised(expected), 0.0)


@pytest.mark.nightly
def test_noisy_gates_of_switches_leave_less_fidelity_than_ideal_ones(tmp_path: Path) -> None:
    """Few pairs a block: some have none left, which ends nothing."""
    errors = "gates.two_qubit_depolarizing=0.02", "gates.readout_error=0.01"
    more = ["--schedule", "nested", "--count", "600", "--sample", "0.5", "--block-pairs", "200"]
    ends = [f"--device={host}.{error}" for host in ("alice", "bob") for error in errors]
    parts = ["analyser.kind=gates", "analysers=1", "memories=2", "sources=1", *errors]
    switches = [f"--switch={part}" for part in parts]
    asking = result_of(tmp_path, *IN_SWITCHES, *ends, *switches, *more)["job"]["asking"]
    assert asking["pairs"] == 600
    assert 0.728 < asking["fidelity"] < nested(1) - 0.02  # above what four links have unpurified


@pytest.mark.nightly
@pytest.mark.parametrize("rounds", [1, 0])
def test_spans_are_purified_before_they_are_swapped(tmp_path: Path, rounds: int) -> None:
    words = ["swap", "--topology", "chain,3", "--purification", "none"]
    words += ["--schedule", "nested", "--purify", str(rounds)] if rounds else []
    words += ["--count", "200", "--sample", "0.8"]
    words += ["--device", f"*.source.fidelity={FIDELITY}"]
    words += ["--switch", f"source.fidelity={FIDELITY}"]
    asking = result_of(tmp_path, *words)["job"]["asking"]
    assert asking["pairs"] == 200
    require_estimate(asking, polarised(nested(rounds)), 0.0)
