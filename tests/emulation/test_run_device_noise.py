"""Noise of one's own in a memory, over the real components: docs/noise-models/ageing.py."""

import re
from math import exp
from pathlib import Path

import pytest
from test_run_nodes import log_of, polarised, require_estimate, result_of

T_S, RATE_HZ = 0.1, 10_000
WAITED = re.compile(r"after ([\d.]+)(?: to ([\d.]+))? s$")


@pytest.mark.nightly
def test_a_memory_ages_as_the_example_says(tmp_path: Path) -> None:
    """Coherence falls by exp(-(t / T)^2) for each part of a wait.

    In the first, of bob's halves, which come one by one, each waits for all that come behind it;
    then software and the way to alice take their time, which is as the log says.
    """
    words = ["distribute", "--rate-hz", str(RATE_HZ), "--count", "300", "--sample", "0.8"]
    words += ["--device", "bob.memory.noise=docs/noise-models/ageing.py:Ageing"]
    words += ["--time", "paced=10"]
    words += ["--device", f'bob.memory.noise_parameters={{"time_s": {T_S}}}']
    asking = result_of(tmp_path, *words)["job"]["asking"]
    pairs = asking["emitted"]
    assert pairs < 2_500  # one block
    (least_s, most_s), *later = waits_until_measured("bob", log_of(tmp_path))
    assert abs(most_s - least_s - (pairs - 1) / RATE_HZ) < 1e-6
    kept = sum(exp(-(((least_s + pair / RATE_HZ) / T_S) ** 2)) for pair in range(pairs)) / pairs
    for part_s, same_s in later:
        assert part_s == same_s
        kept *= exp(-((part_s / T_S) ** 2))
    require_estimate(asking, polarised((1 + kept) / 2), 0.0)


def waits_until_measured(host: str, log: list[str]) -> list[tuple[float, float]]:
    """Return from when to when each part of the wait lasted, of the qubits measured first."""
    found: list[tuple[float, float]] = []
    for line in log:
        if f" {host} " in line:
            if " measure " in line:
                return found
            if waited := WAITED.search(line):
                found.append((float(waited[1]), float(waited[2] or waited[1])))
    raise AssertionError(f"{host} has measured nothing: {log}")
