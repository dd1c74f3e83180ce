"""The report of a run over a real network."""

import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from conftest import qmn, verb


def test_a_run_ends_with_a_report_of_both_layers(tmp_path: Path) -> None:
    noise = ("--depolarizing", "0.005", "--length-km", "5", "--loss-db-per-km", "0.2")
    done = qmn(
        "--message",
        "look at it " * 20,
        *noise,
        "--fec",
        "golay",
        "--frame-bytes",
        "32",
        runs=tmp_path,
        report=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    run = tmp_path / "latest"
    page = (run / "report.html").read_text()
    assert page.count("<figure") == 6  # one path was set up, so there is no chart of set-ups
    assert "Not drawn" not in page

    (handshake,) = re.findall(r"in both layers.*?<svg(.*?)</svg>", page, re.DOTALL)
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", handshake)
    order = [
        "Setup SDC, code golay: GRANTED",
        "packet-in: set-up held",
        "bundled FLOW_MOD × 3",  # noqa: RUF001
        "barrier reply: path ready",
        "packet-out: set-up released",
        "Setup PAIR SOURCE, code golay: GRANTED",
    ]
    places = [texts.index(text) for text in order]
    assert places == sorted(places)
    for host in ("alice", "bob", "charlie", "s1", "c0", "q1"):
        assert host in texts
    assert page.count("5 km, 1 dB") == 3

    result = json.loads((run / "result.json").read_text())
    confusion = np.array(result["job"]["asked"]["confusion"])
    wrong = confusion.sum() - confusion.trace()
    report = result["job"]["asking"]
    assert wrong == report["symbol_errors"] > 0
    assert confusion.sum() <= report["bell_pairs"] - report["lost_pairs"]
    counts = (report[name] for name in ("symbol_errors", "lost_pairs", "repeated_frames"))
    text = "in the end: symbol errors {:,}, lost pairs {:,}, repeated frames {:,}."
    assert text.format(*counts) in page  # as the reports on the wire say

    verb("report", str(run))
    assert (run / "report.html").read_text() == page


@pytest.mark.nightly
def test_a_ring_is_drawn_with_the_ways_that_light_took(tmp_path: Path) -> None:
    words = ["--length-km", "2", "--loss-db-per-km", "0.25", "--message", "around"]
    verb("run", "sdc", "--topology", "ring", "--runs", str(tmp_path), *words)
    page = (tmp_path / "latest" / "report.html").read_text()
    assert "Not drawn" not in page
    ways = set(re.findall(r"<b [^>]*>(\S+ → \S+)</b>", page))
    assert ways == {"alice-q0 → bob-q1", "charlie-q0 → alice-q0", "charlie-q1 → bob-q0"}

    (network,) = re.findall(r"<h2>The network.*?<svg(.*?)</svg>", page, re.DOTALL)
    assert network.count("2 × 2 km, 0.5 dB") == 6  # noqa: RUF001 (bob's, charlie's, the ring's)
    strokes = re.findall(r"stroke: var\(--(\S+)\); stroke-width: 2.4", network)
    # Which path stood first, and so has which colour, is up to the switches.
    assert sorted(Counter(strokes).values()) == [3, 3, 4]
    (losses,) = re.findall(r"<h2>Loss of each hop.*?<svg(.*?)</svg>", page, re.DOTALL)
    assert sorted(re.findall(r">([0-9.]+ dB)<", losses)) == ["1.5 dB", "1.5 dB", "2 dB"]
