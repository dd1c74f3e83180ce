"""Blocks under way at once in a chain of four repeaters, over the real components, beside theory.

Light takes d for a link of 200 km. A block by itself takes 35 d: 10 until bob is asked and has
answered, 15 until all links are there one hop after the other, their swaps are reported and bob has
replied, 10 for the sample. With four, bob is asked for the next while the first is on its way, and
what is left is the sample of each, one after the other.
"""

from math import exp, sqrt
from pathlib import Path

import pytest
from test_run_swap import run

BLOCK = 200
T2_S = 0.2
TURNS = 2  # the load of a machine changes: the first that is in time counts
NODES = ("alice", "r1", "r2", "r3", "r4", "bob")
HOP_S = 200e3 / 2.04e8
ALONE_S, SAMPLE_S = 35 * HOP_S, 10 * HOP_S


@pytest.mark.nightly
@pytest.mark.waits
@pytest.mark.parametrize(
    ("capacity", "scale", "least_per_s", "most_per_s"),
    [
        (8 * BLOCK, 100, BLOCK / ALONE_S, BLOCK / SAMPLE_S),
        (4 * BLOCK - 1, 40, 0.0, BLOCK / ALONE_S),  # one at a time: two would not fit
    ],
)
def test_blocks_follow_each_other_where_memories_take_them_and_their_waits_cost_fidelity(
    tmp_path: Path, capacity: int, scale: int, least_per_s: float, most_per_s: float
) -> None:
    words = ["--topology", "repeaters,4", "--length-km", "100", "--loss-db-per-km", "0"]
    words += ["--count", "500", "--sample", "0.8", "--block-pairs", str(BLOCK)]
    words += ["--time", f"paced={scale}", f"--device=r2.memory.capacity={capacity}"]
    words += [f"--device={node}.memory.t2_s={T2_S}" for node in NODES]
    for turn in range(TURNS):
        result = run(tmp_path / str(turn), *words)
        asking, asked = result["job"]["asking"], result["job"]["asked"]
        rate_per_s = asking["emitted"] / asking["elapsed_s"]
        if rate_per_s > least_per_s:
            break
    assert least_per_s < rate_per_s < most_per_s
    waited_ms = [2 * each for each in asked["repeaters_waited_ms"]]
    waited_s = sum([*waited_ms, asking["sampled_waited_ms"], asked["sampled_waited_ms"]]) / 1e3
    coherent = exp(-waited_s / T2_S)
    variance = 2 * (1 - coherent**2) / 4 / 4 / (asking["sampled"] / 3)  # X and Y; Z is never wrong
    assert abs(asking["fidelity"] - (1 + coherent) / 2) < 5 * sqrt(variance)
