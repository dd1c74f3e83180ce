"""How far behind its network the live view is, how much memory it takes, and what it costs a run.

python tests/live_speed/measure.py                       (root; `make live-speed`)
python tests/live_speed/measure.py --events-per-s 2000 --seconds 90 --rounds 8

First a run of a number of events a second, in turns without a page and with one: the pairs a second
with a page, of those shortly before and after, without the time that opening a page takes. Then a
run as fast as this machine can, which fills its processors: its share is printed, and decides
nothing. Then the events of that run come again, at the given rate, to the same server and page. The
browser is Chromium without a window, which draws as in one.
"""

import argparse
import math
import statistics
import sys
import tempfile
from pathlib import Path

from measured_run import Turn, run
from page import Sample, looked_at, percentile
from replay import replayed

BEHIND_MS, MEMORY_MIB, KEPT = 100, 200, 0.95  # what the live view is to hold
EVENTS_OF_A_BLOCK = 12  # of superdense coding
BESIDE_LIGHT_S = 0.0023  # that a block takes on two processors which have nothing else to do


def main() -> int:
    """Measure, print, and return 1 if the page does not hold what it is to, or such a run."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--events-per-s", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=90.0, help="of events that come again")
    parser.add_argument("--rounds", type=int, default=8, help="of a run, without a page and with")
    parser.add_argument("--turn", type=float, default=6.0, metavar="S", help="how long each is")
    parser.add_argument("--block-pairs", type=int, default=128, help="few: more events a second")
    arguments = parser.parse_args()
    light_s = EVENTS_OF_A_BLOCK / arguments.events_per_s - BESIDE_LIGHT_S
    if light_s <= 0:
        parser.error(f"--events-per-s: at most {EVENTS_OF_A_BLOCK / BESIDE_LIGHT_S:,.0f}")
    with tempfile.TemporaryDirectory() as name:
        asked = arguments.rounds, arguments.turn, arguments.block_pairs
        rate_hz = round(arguments.block_pairs / light_s)
        share = measured(Path(name), *asked, rate_hz)
        measured(Path(name), *asked, None)
        folder = (Path(name) / "latest").resolve()
        with replayed(folder, arguments.events_per_s) as (address, server):
            sample = looked_at(address, arguments.seconds, server)
    return 0 if report(arguments.events_per_s, sample) and share >= KEPT else 1


def measured(
    folder: Path, rounds: int, seconds: float, block_pairs: int, rate_hz: int | None
) -> float:
    """Let a run be looked at in turns; print what it did, and return the mean that it kept."""
    print(f"a run at {rate_hz:,.0f} pairs/s" if rate_hz else "a run that fills its processors")
    _folder, turns = run(folder, rounds, seconds, block_pairs, rate_hz)
    for turn in turns:
        show(turn)
    shares = kept(turns)
    print(f"pairs a second with a page, of those without: {text(shares)}")
    return statistics.mean(shares)


def show(turn: Turn) -> None:
    """Print what a run did for some seconds."""
    page = f"a page: {turn.browser:.2f} of a processor; {turn.text}" if turn.text else "no page"
    print(f"{turn.pairs_per_s:8,.0f} pairs/s  {turn.events_per_s:6,.0f} events/s  {page}")


def report(events_per_s: int, sample: Sample) -> bool:
    """Print what was seen of a page, and return whether it is what it is to be."""
    median, most = (percentile(sample.behind_ms, share) for share in (50, 95))
    print(
        f"{events_per_s} events/s: behind by p50 {median:.0f} ms, p95 {most:.0f} ms, max"
        f" {max(sample.behind_ms):.0f} ms; {sample.frames_per_s:.0f} drawings/s; heap at most"
        f" {sample.heap_mib:.0f} MiB, memory of its own {sample.memory_mib:.0f} MiB; processor:"
        f" browser {sample.browser_cpu:.2f}, server {sample.server_cpu:.2f} of one"
    )
    return most < BEHIND_MS and sample.memory_mib < MEMORY_MIB


def kept(turns: list[Turn]) -> list[float]:
    """Return, of each turn with a page, its part of what those beside it did."""
    rates = [turn.pairs_per_s for turn in turns]
    return [
        2 * rates[number] / (rates[number - 1] + rates[number + 1])
        for number in range(1, len(rates), 2)
    ]


def text(shares: list[float]) -> str:
    """Return the mean with its standard error, and the median: other work comes in bursts."""
    error = statistics.stdev(shares) / len(shares) ** 0.5 if len(shares) > 1 else math.nan
    mean, median = 100 * statistics.mean(shares), 100 * statistics.median(shares)
    return f"{mean:.1f} +- {100 * error:.1f} %, median {median:.1f} %"


if __name__ == "__main__":
    sys.exit(main())
