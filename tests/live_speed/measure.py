"""How far behind its network the live view is, how much memory it takes, and what it costs a run.

python tests/live_speed/measure.py                       (root; `make live-speed`)
python tests/live_speed/measure.py --events-per-s 2000 --seconds 90 --rounds 3

First a run of many small blocks, with no page and with one in turns: pairs a second, and the
processor time of the network for each pair, which other work on this machine changes less. Then
the events of the last run come again, as fast as is said, to the same server and page. The browser
is Chromium without a window; what it draws is as in one.
"""

import argparse
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
    parser.add_argument("--rounds", type=int, default=3, help="of runs, each with and without")
    parser.add_argument("--kilobytes", type=int, default=60, help="that a run sends")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        message = folder / "message"
        message.write_bytes(bytes(range(250)) * 4 * arguments.kilobytes)
        without, beside = [], []
        for _round in range(arguments.rounds):
            without.append(run(folder, message, page=False))
            beside.append(run(folder, message, page=True))
            show("without", without[-1])
            show("with a page", beside[-1])
        kept = ratio(without, beside)
        with replayed(beside[-1].folder, arguments.events_per_s) as (address, server):
            sample = looked_at(address, arguments.seconds, server)
        holds = told(f"{arguments.events_per_s} events/s", sample)
    print(f"the run keeps {100 * kept:.1f} % (of pairs for each second of its processor time)")
    return 0 if holds and kept >= KEPT else 1


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


def ratio(without: list[Measured], beside: list[Measured]) -> float:
    """Return which part of the pairs for its processor time a run with a page keeps."""
    costs = [statistics.median(each.cpu_s_per_pair for each in runs) for runs in (without, beside)]
    return costs[0] / costs[1]


if __name__ == "__main__":
    sys.exit(main())
