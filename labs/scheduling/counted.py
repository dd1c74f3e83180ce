"""Applications over load, by the controller's own decisions in counted time."""

import json
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from controller_apps.policy.orders import Queue
from qmn.live.event_sources import RESULT
from qmn.results.run_folder import make_folder
from qmn.sweeps.packets import Pairs, Requests, ask_in_counted_time, drawn, timetable, tree_of
from topologies.maps import read_map

COUNT, PACKETS, PAIRS, GARR = 30, 10, Pairs(), read_map("garr")
MAPS = {"tree": tree_of(GARR, "rm2"), "garr": GARR}
ORDERS = {"edf": Queue("edf"), "fcfs": Queue(), "timetable": Queue(), "slots": Queue("slots", 0.6)}
RATES, WAYS = (4, 16, 64), (("edf", 0), ("edf", 1), ("edf", 10), ("fcfs", 1), ("slots", 1))
Case = tuple[str, float, str, float, int]  # map, packets/s, order, signalling, their seed
UNTIL_MADE: list[Case] = [  # as theirs
    *(("tree", rate, "edf", 0, draw) for rate in RATES for draw in range(1, 7)),
    *(("tree", 1, "timetable", 0, draw) for draw in range(1, 7)),
    *(("garr", 16, "edf", 0, draw) for draw in range(1, 7)),
]
RELEASED: list[Case] = [  # as many of each application, made or not
    *(("tree", rate, *way, draw) for way in WAYS for rate in RATES for draw in range(1, 4)),
    *(("tree", 1, "timetable", times, draw) for times in (0, 1, 10) for draw in range(1, 4)),
]
KINDS = {"made": (UNTIL_MADE, 100 * PACKETS), "released": (RELEASED, PACKETS)}


def measured(case: Case, seed: int, most: int) -> dict[str, float]:
    """Return what comes of a case in which each application has `most` releases at most."""
    name, rate, order, signalling, draw = case
    applications = drawn(MAPS[name], PAIRS, COUNT, draw)
    starts = timetable(applications, PAIRS) if order == "timetable" else None
    random = np.random.default_rng([seed, draw])
    asking = Requests(applications, PAIRS, PACKETS, rate, random, starts, most)
    ask_in_counted_time(MAPS[name], asking, ORDERS[order], signalling)
    return {"share": asking.share, "turnaround": float(np.mean(asking.turnarounds_s))}


if __name__ == "__main__":
    seed, runs = sys.argv[2::2]  # --seed 1 --runs DIR
    with ProcessPoolExecutor() as workers:
        told = defaultdict(list)
        for kind, (cases, most) in KINDS.items():
            found = workers.map(partial(measured, seed=int(seed), most=most), cases)
            for (*case, _draw), each in zip(cases, found, strict=True):
                told[" ".join(map(str, (kind, *case)))].append(each)
    (make_folder(Path(runs), "counted") / RESULT).write_text(json.dumps(told))
