"""The closed forms give the numbers that the literature gives."""

import pytest

from qmn.sweeps import theory
from qmn.sweeps.coding_theory import residual_error


def test_the_capacity_at_the_experiments_p_is_the_experiments() -> None:
    assert theory.capacity(theory.EXPERIMENT_P) == pytest.approx(1.665, abs=5e-4)


@pytest.mark.parametrize(
    ("p", "code", "consecutive", "interleaved"),
    [
        (0.05, "none", 2.5e-2, 2.5e-2),
        (0.05, "repetition", 1.313e-2, 1.844e-3),
        (0.05, "hamming", 2.008e-2, 5.230e-3),
        (0.05, "golay", 3.665e-3, 7.271e-4),
        (0.1, "repetition", 2.75e-2, 7.25e-3),
        (0.1, "hamming", 4.252e-2, 1.943e-2),
        (0.1, "golay", 1.699e-2, 8.018e-3),
    ],
)
def test_the_table_of_codes(p: float, code: str, consecutive: float, interleaved: float) -> None:
    assert residual_error(code, False, p) == pytest.approx(consecutive, rel=5e-4)
    assert residual_error(code, True, p) == pytest.approx(interleaved, rel=5e-4)


def test_a_code_that_is_not_perfect_has_no_theory() -> None:
    assert residual_error("reed-solomon", True, 0.05) is None


def test_swapping_is_not_the_product_of_fidelities() -> None:
    assert theory.swapped_fidelity(0.9, 0.8) == pytest.approx(0.9 * 0.8 + 0.1 * 0.2 / 3)
    assert theory.swapped_fidelity(0.25, 1.0) == 0.25


def test_a_perfect_pair_breaks_bells_inequality_and_noise_does_not() -> None:
    assert theory.chsh(1.0) == pytest.approx(2 * 2**0.5)
    assert theory.chsh(0.25) == 0
