"""What a run's report shows of a real network."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from conftest import ROOT, qmn


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
    )
    assert done.returncode == 0, done.stdout + done.stderr
    run = tmp_path / "latest"
    page = (run / "report.html").read_text()
    assert page.count("<figure") == 7
    assert "Not drawn" not in page

    (handshake,) = re.findall(r"in both layers.*?<svg(.*?)</svg>", page, re.DOTALL)
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", handshake)
    order = [
        "Setup SDC, code golay: GRANTED",
        "packet-in: set-up held",
        "bundled FLOW_MOD",
        "barrier reply: path ready",
        "packet-out: set-up released",
        "Setup PAIR SOURCE, code golay: GRANTED",
    ]
    places = [texts.index(text) for text in order]
    assert places == sorted(places)
    for host in ("alice", "bob", "charlie", "s1", "c0", "q1"):
        assert host in texts
    assert page.count("5 km, 1 dB") == 5

    result = json.loads((run / "result.json").read_text())
    confusion = np.array(result["confusion"])
    wrong = confusion.sum() - confusion.trace()
    assert wrong == result["symbol_errors"] > 0
    assert confusion.sum() <= result["bell_pairs"] - result["lost_pairs"]

    command = [sys.executable, "-m", "qmn", "report", str(run)]
    subprocess.run(command, cwd=ROOT, check=True, timeout=60)
    assert (run / "report.html").read_text() == page
