"""Attacks on light: what eve knows, against the closed forms that the papers give."""

from math import exp, sqrt

import pytest

from evidence.attacks import photons
from evidence.attacks.laboratory import ATTACKS, LightAttack
from evidence.attacks.photons import Spied

BITS = 20_000


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("intercept-resend", 1 / 2),  # her basis is theirs half the time (Bennett, Brassard 1984)
        ("fiber-tap", photons.TAPPED / 2),
        ("photon-splitting", 1.0),  # at this loss pulses of several alone are sent on
    ],
)
def test_eve_knows_as_much_as_theory_says_and_a_key_with_its_defence_tells_her_nothing(
    name: str, known: float
) -> None:
    attack = ATTACKS[name]
    assert isinstance(attack, LightAttack)
    reached, bits = attack.trial(False, BITS)
    assert bits > BITS / 4
    assert abs(reached / bits - known) <= 5 * sqrt(known * (1 - known) / bits)
    assert attack.trial(True, BITS)[0] == 0


def test_at_the_loss_that_splitting_hides_single_photons_are_not_needed() -> None:
    """Pulses of several photons are more than what is expected to be seen (Brassard et al. 2000).

    P(n >= 2) = 1 - exp(-m)(1 + m), and 1 - exp(-m t) is expected.
    """
    mean, transmission = 0.5, 10 ** (-photons.HIDDEN_DB / 10)
    assert 1 - exp(-mean) * (1 + mean) > 1 - exp(-mean * transmission)


@pytest.mark.parametrize(
    ("known", "length", "left"), [(10, 100, 10), (10, 95, 5), (10, 90, 0), (10, 0, 0)]
)
def test_amplification_takes_away_what_eve_knows_first(
    known: int, length: float, left: int
) -> None:
    assert Spied(100, known, 0).left(length) == left
