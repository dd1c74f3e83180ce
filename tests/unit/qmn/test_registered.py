"""Packages that register verbs, jobs and programs by entry points."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from limits import SOON_S

from wire.registered import CLICK_OBSERVERS, TELEMETRY, BadPackage, only

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = """
import sys
VERBS = {"make experiments": {"hello": (__name__, "greet")}}
HELP = "nothing, over a network"

def add_parser(verbs):
    verbs.add_parser("hello").set_defaults(call=lambda arguments: print("hello") or 0)

def describe(parser):
    parser.add_argument("--loud", action="store_true")
    parser.set_defaults(call=lambda arguments: print(arguments.loud) or 3)
"""
METADATA = "Metadata-Version: 2.1\nName: greeting\nVersion: 1\n"


def install(folder: Path, entry_points: str) -> None:
    """Put a package and its metadata where pip would put them."""
    (folder / "greeting.py").write_text(PACKAGE)
    (folder / "greeting-1.dist-info").mkdir()
    (folder / "greeting-1.dist-info" / "METADATA").write_text(METADATA)
    (folder / "greeting-1.dist-info" / "entry_points.txt").write_text(entry_points)


def qmn(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run qmn where this folder is one of Python's."""
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{folder}"}
    command = [sys.executable, "-m", "qmn", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SOON_S)


def test_an_installed_package_has_a_verb_of_its_own(tmp_path: Path) -> None:
    install(tmp_path, "[qmn.verbs]\ngreeting = greeting:VERBS\n")
    usage = qmn(tmp_path, "--help").stdout
    assert "  hello       greet\n" in usage.partition("make experiments:")[2]
    done = qmn(tmp_path, "hello")
    assert (done.stdout, done.returncode) == ("hello\n", 0)


def test_an_installed_package_has_a_job_of_its_own(tmp_path: Path) -> None:
    install(tmp_path, "[qmn.jobs]\ngreet = greeting\n")
    assert "nothing, over a network" in qmn(tmp_path, "run", "--help").stdout
    assert "--loud" in qmn(tmp_path, "run", "greet", "--help").stdout


TWO = "one = greeting:VERBS\nother = greeting:VERBS\n"


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(
    ("option", "group"), [("--tags=new", CLICK_OBSERVERS), ("--gnmi", TELEMETRY)]
)
def test_a_second_package_for_what_one_serves_is_named(
    tmp_path: Path, option: str, group: str
) -> None:
    install(tmp_path, f"[{group}]\n{TWO}")
    done = qmn(tmp_path, "run", "sdc", "--message", "x", option)
    assert done.returncode != 0
    assert "one package provides" in done.stderr
    assert "greeting:VERBS" in done.stderr.partition("keep one of ")[2]


@pytest.mark.parametrize("group", [CLICK_OBSERVERS, TELEMETRY])
def test_what_no_package_serves_is_to_be_installed(
    monkeypatch: pytest.MonkeyPatch, group: str
) -> None:
    monkeypatch.setattr("wire.registered._selection", lambda: lambda **_group: ())
    with pytest.raises(BadPackage, match=f"--x: one package provides {group}: install one"):
        only("--x", group)


def test_a_job_without_help_is_named_and_left_out(tmp_path: Path) -> None:
    install(tmp_path, "[qmn.jobs]\ngreet = greeting\n")
    module = tmp_path / "greeting.py"
    module.write_text(module.read_text().replace("HELP", "HINT"))
    done = qmn(tmp_path, "run", "--help")
    assert (done.returncode, " greet " in done.stdout) == (0, False)
    assert "qmn.jobs: greet (greeting) is left out: " in done.stderr


def test_a_name_that_is_taken_is_refused(tmp_path: Path) -> None:
    install(tmp_path, "[qmn.verbs]\nviews = greeting:VERBS\n")
    done = qmn(tmp_path, "--help")
    assert done.returncode == 1
    assert "two entry points of qmn.verbs have the same name" in done.stderr


def test_a_verb_that_is_there_is_refused(tmp_path: Path) -> None:
    install(tmp_path, "[qmn.verbs]\ngreeting = greeting:VERBS\n")
    module = tmp_path / "greeting.py"
    module.write_text(module.read_text().replace('"hello": (', '"run": ('))
    done = qmn(tmp_path, "--help")
    assert done.returncode == 1
    assert "greeting: qmn.verbs.run is the verb run; rename one" in done.stderr


def test_a_broken_service_is_left_out_with_its_verb(tmp_path: Path) -> None:
    install(
        tmp_path, "[qmn.services]\nhum = greeting:HUM\n[qmn.service_verbs]\nhum = greeting:hum\n"
    )
    module = tmp_path / "greeting.py"
    verb = "from qmn.requests.service_verbs import Verb\nhum = Verb('hum', 'hums')\n"
    module.write_text(module.read_text() + verb)
    done = qmn(tmp_path, "run", "--help")
    assert (done.returncode, " hum " in done.stdout) == (0, False)
    assert "qmn.services: hum (greeting:HUM) is left out: " in done.stderr
    assert "deliver pairs of a required fidelity" in done.stdout
