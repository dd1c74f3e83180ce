"""Labs in networks: one that agrees, and one that says another number than what comes out."""

import json
import subprocess
import sys
from pathlib import Path

from conftest import ROOT

from qmn.labs import catalogue

OTHER = """
from qmn.labs.lab import Lab, exactly

LAB = Lab(
    "a lab that cannot agree",
    "nobody's",
    {"short": "run sdc --message N --captures none --no-report"},
    lambda runs: [exactly("Bell pairs", runs["short"].result["bell_pairs"], 5, "nowhere")],
)
"""


def lab(name: str, out: Path) -> subprocess.CompletedProcess[str]:
    """Do a lab to its end."""
    command = [sys.executable, "-m", "qmn", "lab", name, "--out", str(out)]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=110
    )


def test_the_source_papers_figures_are_seen(tmp_path: Path) -> None:
    done = lab("paper", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "within 5 standard errors" in done.stdout
    (folder,) = tmp_path.iterdir()
    facts = json.loads((folder / "lab.json").read_text())
    assert [each["ours"] for each in facts["findings"]] == [4, 4, 4, 4, 1]
    page, traffic = ((folder / name).read_text() for name in ("handshakes.html", "wireshark.txt"))
    for name in ("I: Phi+", "X: Psi+", "Z: Phi-", "XZ: Psi-"):
        assert f"<h2>{name}</h2>" in page
    assert "10.0.0.1 → 10.0.0.2" in traffic  # bob
    assert "10.0.0.1 → 10.0.0.4" in traffic  # ed


def test_a_lab_that_does_not_agree_ends_with_status_1(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "other.py").write_text(OTHER)
    done = lab(f"{tmp_path}/other", tmp_path / "out")
    assert done.returncode == 1, done.stdout + done.stderr
    assert "NOT within 5 standard errors" in done.stdout
    (folder,) = (tmp_path / "out").iterdir()
    (finding,) = json.loads((folder / "lab.json").read_text())["findings"]
    assert (finding["ours"], finding["published"], finding["agrees"]) == (4, 5, False)


def test_classical_light_in_the_photons_band_spoils_what_is_teleported(tmp_path: Path) -> None:
    """10 mW at 1550 nm: F = .58986 by the supplement's equations, and .96513 without them."""
    settings = catalogue.lab("coexistence").findings.__globals__["settings"]
    command = [sys.executable, "-m", "qmn", "run", "teleport", "--state", "0"]
    command += ["--count", "1000000", "--block-pairs", "262144", "--no-report", "--no-record"]
    command += ["--runs", str(tmp_path)]
    done = subprocess.run(
        [*command, "--captures", "none", "--seed", "1", *settings("c-band", 10.0)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=110,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    told = json.loads((tmp_path / "latest" / "result.json").read_text())["asking"]
    sigma = (0.58986 * (1 - 0.58986) / told["arrived"]) ** 0.5
    assert 5 * sigma < 0.96513 - 0.58986  # so many have arrived that it can be told
    assert abs(told["fidelity"] - 0.58986) < 5 * sigma
