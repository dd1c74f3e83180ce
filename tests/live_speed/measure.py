"""How far behind its network the live view is, how much memory it takes, and what it costs a run.

python tests/live_speed/measure.py                       (root; `make live-speed`)
python tests/live_speed/measure.py --events-per-s 2000 --seconds 90 --rounds 3

First a run of many small blocks, in turns with no page, with one, and beside a page that shows what
came of another run: pairs a second, and the processor time of the network for each pair. A browser
takes caches and processors from all programs of a machine; what a network does for its page is what
the run with one takes more than the run beside another's. Then the events of the last run come
again, as fast as is said, to the same server and page. The browser is Chromium without a window;
what it draws is as in one.
"""

import argparse
import math
import statistics
import sys
import tempfile
from pathlib import Path

from measured_run import Measured, run
from page import Sample, looked_at, percentile
from replay import replayed

BEHIND_MS, MEMORY_MIB, KEPT = 100, 200, 0.95  # what the live view is to hold


def main() -> int:
    """Measure, print, and return 1 if the page or the run does not hold what it is to hold."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--events-per-s", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=90.0, help="of events that come again")
    parser.add_argument("--rounds", type=int, default=3, help="of runs of each kind")
    parser.add_argument("--kilobytes", type=int, default=60, help="that a run sends")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        message = folder / "message"
        message.write_bytes(bytes(range(250)) * 4 * arguments.kilobytes)
        without, with_page, beside = [], [], []
        for number in range(arguments.rounds):
            without.append(run(folder, message))
            show("without", without[-1])
            for page in (True, False) if number % 2 else (False, True):
                if page:
                    with_page.append(run(folder, message, page=True))
                    show("with a page", with_page[-1])
                else:
                    beside.append(run(folder, message, beside=without[-1]))
                    show("beside one", beside[-1])
        with replayed(with_page[-1].folder, arguments.events_per_s) as (address, server):
            sample = looked_at(address, arguments.seconds, server)
        holds = told(f"{arguments.events_per_s} events/s", sample)
    for what, of in (("by the clock", by_clock), ("for its processor time", by_processors)):
        print(f"of pairs a second {what}, a run")
        print(f"  beside another's page keeps of those without {said(of(without, beside))}")
        print(f"  with a page keeps of those without           {said(of(without, with_page))}")
        print(f"  with a page keeps of those beside another's  {said(of(beside, with_page))}")
    return 0 if holds and statistics.mean(by_clock(without, with_page)) >= KEPT else 1


def show(what: str, measured: Measured) -> None:
    """Print a run."""
    print(
        f"{what:<12} {measured.pairs_per_s:8,.0f} pairs/s  {1e6 * measured.cpu_s_per_pair:7.1f} us"
        f" of processor a pair  {measured.events_per_s:6,.0f} events/s",
        flush=True,
    )
    if measured.page:
        told("  its page", measured.page)


def told(what: str, sample: Sample) -> bool:
    """Print what was seen of a page, and return whether it is what it is to be."""
    median, most = (percentile(sample.behind_ms, share) for share in (50, 95))
    print(
        f"{what}: behind by p50 {median:.0f} ms, p95 {most:.0f} ms, max {max(sample.behind_ms):.0f}"
        f" ms; {sample.frames_per_s:.0f} drawings/s; heap at most {sample.heap_mib:.0f} MiB, memory"
        f" of its own {sample.memory_mib:.0f} MiB; processor: page {sample.page_cpu:.2f}, server"
        f" {sample.server_cpu:.2f} of one",
        flush=True,
    )
    return most < BEHIND_MS and sample.memory_mib < MEMORY_MIB


def by_clock(one: list[Measured], other: list[Measured]) -> list[float]:
    """Return, of each round, which part of one's pairs a second the other has."""
    return [b.pairs_per_s / a.pairs_per_s for a, b in zip(one, other, strict=True)]


def by_processors(one: list[Measured], other: list[Measured]) -> list[float]:
    """Return, of each round, which part of one's pairs for its processor time the other has."""
    return [a.cpu_s_per_pair / b.cpu_s_per_pair for a, b in zip(one, other, strict=True)]


def said(shares: list[float]) -> str:
    """Return the mean of rounds with its standard error."""
    error = statistics.stdev(shares) / len(shares) ** 0.5 if len(shares) > 1 else math.nan
    return f"{100 * statistics.mean(shares):.1f} +- {100 * error:.1f} %"


if __name__ == "__main__":
    sys.exit(main())
