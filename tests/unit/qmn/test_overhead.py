"""What the rates of runs come down to, and that no kind of run always has the same place."""

from qmn.benchmarks.overhead import EVERYTHING, KINDS, NOTHING, Measured, figures, order


def test_a_share_is_of_the_bare_run_in_the_same_round() -> None:
    bare, kept = [1_000_000.0, 500_000.0, 2_000_000.0], [900_000.0, 350_000.0, 1_600_000.0]
    rounds = [
        {kind: Measured(rate if kind == NOTHING else other) for kind in KINDS}
        for rate, other in zip(bare, kept, strict=True)
    ]
    rounds[1][EVERYTHING] = Measured(350_000.0, packets_missed=2)
    told = dict(figures(rounds))
    assert told[f"qmn run sdc, {NOTHING}"] == "1,000,000 Bell pairs/s, 100% (100% to 100%)"
    assert told[f"qmn run sdc, {EVERYTHING}"] == "900,000 Bell pairs/s, 80% (70% to 90%)"
    assert told["  packets not captured"] == "2"
    assert len(told) == len(KINDS) + 1


def test_every_second_round_goes_backwards() -> None:
    assert order(0) == order(2) == list(KINDS)
    assert order(1) == list(reversed(KINDS))
