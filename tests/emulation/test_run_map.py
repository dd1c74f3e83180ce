"""A network on a known map: light is lost by its kilometres, and spoilt by each of its fibres."""

import json
from importlib.resources import files
from math import sqrt
from pathlib import Path

import networkx
from limits import PROGRAM_S
from loaded import run_qmn

LOSS_DB_PER_KM, DEPOLARIZING, COUNT = 0.001, 0.004, 20_000
AT_HOST_KM = 0.01  # each fibre from a host to its switch
ENDS = ("STTLng", "WASHng")


def abilene() -> networkx.Graph:
    """Return networkx's reading of topohub's map, names for nodes."""
    given = json.loads((files("topohub") / "data/sndlib/abilene.json").read_text())
    graph = networkx.node_link_graph(given, edges="edges")
    return networkx.relabel_nodes(graph, dict(graph.nodes(data="name")))


def test_seattle_and_washington_teleport_as_the_lengths_of_the_map_say(tmp_path: Path) -> None:
    words = [
        "run",
        "teleport",
        "--topology",
        f"map,abilene,hosts_at={','.join(ENDS)}",
        "--seed",
        "1",
    ]
    words += ["--from", "sttlng", "--to", "washng", "--count", f"{COUNT}", "--captures", "none"]
    words += ["--loss-db-per-km", f"{LOSS_DB_PER_KM}", "--depolarizing", f"{DEPOLARIZING}"]
    done = run_qmn(*words, "--runs", str(tmp_path), timeout_s=PROGRAM_S)
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads((tmp_path / "latest" / "result.json").read_text())
    graph = abilene()
    away = networkx.eccentricity(graph, weight="dist")
    source = min(away, key=away.__getitem__)
    ways = [networkx.dijkstra_path(graph, source, end, weight="dist") for end in ENDS]
    km = sum(networkx.path_weight(graph, way, "dist") + 2 * AT_HOST_KM for way in ways)
    fibers = sum(len(way) + 1 for way in ways)
    reply = result["job"]["asking"]
    wanted = 10 ** (-LOSS_DB_PER_KM * km / 10)
    assert abs(reply["arrived"] / COUNT - wanted) < 5 * sqrt(wanted * (1 - wanted) / COUNT)
    # Each fibre shrinks the Bloch ball by 1 - p (Nielsen and Chuang, 8.3.4): a Werner pair of
    # F = 1 - 3p/4, by which states teleport with (2F + 1)/3 on average (Horodecki et al. 1999).
    p = 1 - (1 - DEPOLARIZING) ** fibers
    wanted = (2 * (1 - 0.75 * p) + 1) / 3
    arrived = reply["arrived"]
    assert abs(reply["fidelity"] - wanted) < 5 * sqrt(wanted * (1 - wanted) / arrived)
    assert result["network"]["positions"]["src"] == list(graph.nodes[source]["pos"])
    report = (tmp_path / "latest" / "report.html").read_text()
    assert "the network on its map" in report
    assert "1571.42 km" in report  # Seattle to Denver
