"""Pairs that a station heralds, over the real components, beside p c / 2L and closed forms."""

from math import sqrt
from pathlib import Path

from test_run_nodes import require_estimate, result_of

M_PER_S = 2.04e8  # of light in fibre
KM = 50.0
TWO_CLICK = [
    word
    for host in ("alice", "bob")
    for word in (
        *("--device", f"{host}.emitter.scheme=two-click"),
        *("--device", f"{host}.emitter.efficiency=0.5"),
        *("--device", f"{host}.emitter.fidelity=0.98"),
        *("--device", f"{host}.emitter.modes=20"),
    )
]


def test_pairs_are_heralded_at_the_rate_of_round_trips_to_the_station(tmp_path: Path) -> None:
    words = ["distribute", "--node", "charlie=station", *TWO_CLICK, "--count", "400"]
    words += ["--device", "charlie.analyser.visibility=1", "--sample", "0.5"]
    words += ["--device", "charlie.detectors.dark_count_hz=0"]
    told = result_of(tmp_path, *words, "--length-km", str(KM), "--loss-db-per-km", "0.02")
    asking = told["asking"]
    efficiency = 0.5 * 10 ** (-2 * KM * 0.02 / 10)  # two fibres to the station
    p = efficiency**2 / 2
    expected = p * asking["attempts"]
    assert abs(asking["emitted"] - expected) < 5 * sqrt(expected) + 20 * p
    least_s = asking["attempts"] / 20 * 2 * (2 * KM * 1e3) / M_PER_S
    assert asking["elapsed_s"] > 0.99 * least_s  # and beside it messages and programs
    swapped = (4 * (0.98**2 + 0.02**2 / 3) - 1) / 3
    require_estimate(asking, swapped, 0.0)
