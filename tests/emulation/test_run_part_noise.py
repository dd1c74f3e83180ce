"""Noise of one's own in a memory, over the real components: examples/ageing.py, as it says."""

from math import exp
from pathlib import Path

from test_run_nodes import polarised, require_estimate, result_of

T_S, RATE_HZ = 0.1, 10_000


def test_a_memory_ages_as_the_example_says(tmp_path: Path) -> None:
    """Bob's halves come one by one, and wait for the last: exp(-(t / T)^2), on average."""
    words = ["distribute", "--rate-hz", str(RATE_HZ), "--count", "300", "--sample", "0.8"]
    words += ["--device", "bob.memory.noise=examples/ageing.py:Ageing", "--time-scale", "10"]
    words += ["--device", f'bob.memory.noise_parameters={{"time_s": {T_S}}}']
    asking = result_of(tmp_path, *words)["asking"]
    pairs = asking["emitted"]
    assert pairs < 2_500  # one block
    kept = sum(exp(-((pair / RATE_HZ / T_S) ** 2)) for pair in range(pairs)) / pairs
    require_estimate(asking, polarised((1 + kept) / 2), 0.0)
