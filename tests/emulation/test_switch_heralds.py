"""Pairs that stations in switches herald, over the real components, beside closed forms."""

from math import sqrt
from pathlib import Path

import pytest
from test_run_heralded import FIDELITY, KM, M_PER_S, OF_A_LINK, emitters
from test_run_nodes import require_estimate, result_of

EMITTER = {"scheme": "two-click", "efficiency": "0.5", "fidelity": str(FIDELITY), "modes": "20"}


def switches(count: int) -> list[str]:
    """Return the options of a chain in which every second switch is a repeater, the rest stations.

    Hosts at its ends have the same emitters.
    """
    said = emitters("alice", "bob")
    for number in range(1, count + 1):
        parts = {"parts": "station", "detectors.dark_count_hz": "0"}
        if number % 2 == 0:
            parts = {"analysers": "1", "memories": "2", "memory.kind": "emissive"}
            parts |= {f"emitter.{name}": value for name, value in EMITTER.items()}
        said += [word for name in parts for word in ("--switch", f"q{number}.{name}={parts[name]}")]
    return [*said, "--topology", f"chain,{count}", "--count", "400", "--sample", "0.5"]


def test_a_station_in_a_switch_heralds_at_the_rate_of_round_trips(tmp_path: Path) -> None:
    words = [*switches(1), "--length-km", str(KM), "--loss-db-per-km", "0.02"]
    asking = result_of(tmp_path, "swap", *words)["job"]["asking"]
    efficiency = 0.5 * 10 ** (-KM * 0.02 / 10)
    p = efficiency**2 / 2
    expected = p * asking["attempts"]
    assert abs(asking["emitted"] - expected) < 5 * sqrt(expected) + 20 * p
    least_s = asking["attempts"] / 20 * 2 * KM * 1e3 / M_PER_S
    assert asking["elapsed_s"] > 0.99 * least_s  # and beside it messages and programs
    require_estimate(asking, OF_A_LINK, 0.0)


@pytest.mark.parametrize("count", [3, pytest.param(9, marks=pytest.mark.nightly)])
def test_switches_with_memories_that_emit_swap_heralded_links(tmp_path: Path, count: int) -> None:
    asking = result_of(tmp_path, "swap", *switches(count), "--length-km", "5")["job"]["asking"]
    require_estimate(asking, OF_A_LINK ** ((count + 1) // 2), 0.0)
    log = (tmp_path / "latest" / "quantum.log").read_text()
    told = {line.split()[1] for line in log.splitlines() if " herald " in line}
    assert told == {f"q{number}-analyser1" for number in range(1, count + 1, 2)}
