"""Labs in networks: one that agrees, and one that says another number than what comes out."""

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, wait_until
from limits import PROGRAM_S, SOON_S

from evidence.labs import catalogue

OTHER = """
from evidence.labs.lab import Lab, exactly

LAB = Lab(
    "a lab that cannot agree",
    "nobody's",
    {"short": "run sdc --message N --captures none --without report"},
    lambda runs: [exactly("Bell pairs", runs["short"].result["pairs_made"], 5, "nowhere")],
)
"""


# A run that writes down that it was done, and fails, or goes on, until there is a file `go`.
SCRIPT = """
import sys, time
from pathlib import Path
_seed, seed, _runs, runs = sys.argv[1:]
name = Path(runs).name
here = Path({here!r})
with (here / "done").open("a") as done:
    done.write(f"{{name}} ")
while name == "slow" and not (here / "go").exists():
    time.sleep(0.05)
if name == "bad" and not (here / "go").exists():
    sys.exit("qmn: there is no go")
folder = Path(runs) / "20260101T000000"
folder.mkdir(parents=True, exist_ok=True)
(folder / "result.json").write_text('{{"value": ' + seed + "}}")
"""
MADE = """
from evidence.labs.lab import Lab, exactly

LAB = Lab(
    "a lab of scripts",
    "nobody's",
    {{name: "script {script}" for name in {runs!r}}},
    lambda runs: [exactly("value", sum(run.result["value"] for run in runs.values()), {sum}, "")],
)
"""


def labs_of_scripts(folder: Path, runs: dict[str, list[str]], wrong: str = "") -> list[str]:
    """Make labs of these runs; what one of them expects is wrong. Return their paths."""
    script = folder / "script.py"
    script.write_text(SCRIPT.format(here=str(folder)))
    for name, own in runs.items():
        (folder / name).mkdir()
        text = MADE.format(script=script, runs=own, sum=len(own) + (name == wrong))
        (folder / name / f"{name}.py").write_text(text)
    return [str(folder / name) for name in runs]


def labs(names: list[str], out: Path, *words: str) -> "subprocess.Popen[str]":
    """Begin to do labs."""
    command = [sys.executable, "-m", "qmn", "lab", "published", *names, "--out", str(out), *words]
    return subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.nightly
def test_labs_go_on_behind_one_that_fails_and_resume_does_what_is_left(tmp_path: Path) -> None:
    runs = {"one": ["a", "bad", "b"], "two": ["c"], "three": ["d"]}
    names, out = labs_of_scripts(tmp_path, runs, wrong="three"), tmp_path / "out"
    text, why = (done := labs(names, out)).communicate(timeout=PROGRAM_S)
    assert done.returncode == 1
    assert "lab 2 of 3, 2 of 5 runs left" in text
    assert f"{names[0]} failed: bad: there is no go" in why
    assert f"beyond its tolerance: {names[2]}" in why
    assert why.endswith("qmn: the same command with --resume goes on where this one ended\n")
    assert (tmp_path / "done").read_text() == "a bad c d "
    (tmp_path / "go").touch()
    text, why = (done := labs(names[:2], out, "--resume")).communicate(timeout=PROGRAM_S)
    assert (done.returncode, why) == (0, "")
    assert "lab 1 of 2, 2 of 4 runs left" in text
    assert (tmp_path / "done").read_text() == "a bad c d bad b "
    assert len(list(out.iterdir())) == 3  # in the same folders
    facts = facts_of(out, "one")
    assert (facts["agrees"], list(facts["runs"])) == (True, ["a", "bad", "b"])
    # Another seed begins again, and so does a call that does not ask for the old.
    for words in (["--resume", "--seed", "2"], []):
        labs(names[1:2], out, *words).communicate(timeout=PROGRAM_S)
    assert (tmp_path / "done").read_text() == "a bad c d bad b c c "


def facts_of(out: Path, name: str) -> dict[str, Any]:
    """Return what the newest folder of a lab says of it."""
    facts: dict[str, Any] = json.loads((max(out.glob(f"*-{name}")) / "lab.json").read_text())
    return facts


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_labs_that_were_interrupted_go_on(tmp_path: Path, number: int) -> None:
    names, out = labs_of_scripts(tmp_path, {"one": ["a", "slow", "b"]}), tmp_path / "out"
    done, doing = tmp_path / "done", labs(names, out)
    wait_until(lambda: done.exists() and done.read_text() == "a slow ", "the second run")
    doing.send_signal(number)
    _said, why = doing.communicate(timeout=SOON_S)
    assert doing.returncode == 128 + number
    assert why.endswith("the same command with --resume goes on where this one ended\n")
    (tmp_path / "go").touch()
    _said, why = (doing := labs(names, out, "--resume")).communicate(timeout=PROGRAM_S)
    assert (doing.returncode, why) == (0, "")
    assert done.read_text() == "a slow slow b "


def lab(name: str, out: Path) -> subprocess.CompletedProcess[str]:
    """Do a lab to its end."""
    command = [sys.executable, "-m", "qmn", "lab", "published", name, "--out", str(out)]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PROGRAM_S
    )


@pytest.mark.nightly
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


@pytest.mark.nightly
def test_classical_light_in_the_photons_band_spoils_what_is_teleported(tmp_path: Path) -> None:
    """10 mW at 1550 nm: F = .58986 by the supplement's equations, and .96513 without them."""
    settings = catalogue.lab("coexistence").findings.__globals__["settings"]
    command = [sys.executable, "-m", "qmn", "run", "teleport", "--state", "0"]
    command += [
        "--count",
        "1000000",
        "--block-pairs",
        "262144",
        "--without",
        "report,record",
    ]
    command += ["--runs", str(tmp_path)]
    done = subprocess.run(
        [*command, "--captures", "none", "--seed", "1", *settings("c-band", 10.0)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=PROGRAM_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    report = json.loads((tmp_path / "latest" / "result.json").read_text())["job"]["asking"]
    sigma = (0.58986 * (1 - 0.58986) / report["arrived"]) ** 0.5
    assert 5 * sigma < 0.96513 - 0.58986  # enough have arrived to tell
    assert abs(report["fidelity"] - 0.58986) < 5 * sigma
