"""Applications over load, by the controller's own decisions in counted time."""

import json
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from numpy.random import default_rng

from controller_apps.policy.schedules import Queue
from evidence.curves.packets import Drawn, measured, tree_of
from qmn.results.run_folder import make_folder
from topologies.catalogue.maps import read_map
from wire.results.run_result import RESULT

COUNT, PACKETS, GARR = 30, 10, read_map("garr")
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


def of(case: Case, seed: int, most: int) -> dict[str, float]:
    """Return the figures of a case in which each application has `most` releases at most."""
    name, rate, order, signalling, draw = case
    drawn = Drawn(COUNT, draw, PACKETS, rate, order == "timetable", most)
    return measured(MAPS[name], drawn, ORDERS[order], signalling, default_rng([seed, draw]))


if __name__ == "__main__":
    seed, runs = sys.argv[2::2]  # --seed 1 --runs DIR
    with ProcessPoolExecutor() as workers:
        figures = defaultdict(list)
        for kind, (cases, most) in KINDS.items():
            found = workers.map(partial(of, seed=int(seed), most=most), cases)
            for (*case, _draw), each in zip(cases, found, strict=True):
                figures[" ".join(map(str, (kind, *case)))].append(each)
    (make_folder(Path(runs), "counted") / RESULT).write_text(json.dumps(figures))
