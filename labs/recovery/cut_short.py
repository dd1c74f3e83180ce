"""Pairs of alice and charlie before, while and after the fibres between their buildings are cut."""

import json
import sys
from collections import Counter
from pathlib import Path

from campus import Campus

from evidence.networks.flapping import dark_spans
from evidence.networks.point_network import session
from qmn.results.run_folder import make_folder
from qmn.scripting import QuantumNetwork, start
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.events.event_sources import recorded
from wire.results.run_result import RESULT

ENDS, WAY, SESSIONS = ("alice", "charlie"), ("source", "charlie"), 5
CUT_S = 0.03  # some of the light of a session has come by the short way


def shared(network: QuantumNetwork, cut: bool = False) -> Counter[str]:
    """Share pairs; count those made, sampled and found as Phi+, and photons that came."""
    earlier = came(network)
    with session(network, "distribute", ENDS, count=200, sample=0.4, rate_hz=250_000) as running:
        if cut:
            network.sleep(CUT_S)
            network.net.configLinkStatus("q1", "q3", "down")
        running.results()
        summary = running.summary
    like_phi = round(summary["sampled"] * (2 * summary["fidelity"] + 1) / 3)
    counts = {"came": came(network) - earlier, "like_phi": like_phi}
    return Counter({**counts, "emitted": summary["emitted"], "sampled": summary["sampled"]})


def came(network: QuantumNetwork) -> int:
    return sum(fiber.photons_to_a or 0 for fiber in network.fibers() if fiber.a == "charlie-q0")


seed, runs = sys.argv[2::2]  # --seed 1 --runs DIR
folder = make_folder(Path(runs), "campus")
with start(Campus, folder, seed=int(seed)) as network:
    before = sum((shared(network) for _ in range(SESSIONS)), Counter())
    stamp_ns = network.runtime.time.stamp_ns
    begin_ns, _counts, end_ns = stamp_ns(), shared(network, cut=True), stamp_ns()
    after = sum((shared(network) for _ in range(SESSIONS)), Counter())
    dark = dark_spans(recorded(folder / EVENT_CAPTURE, follow=False), network.runtime.fibers, WAY)
outage_ns = max(end - begin for begin, end in dark if begin_ns < begin and end < end_ns)
found = {"found": {"before": before, "after": after, "outage_s": outage_ns / 1e9}}
(folder / RESULT).write_text(json.dumps(json.loads((folder / RESULT).read_text()) | found))
