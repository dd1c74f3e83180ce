"""The command `qmn` itself: from anywhere, as root where it must be, on the PATH and off again."""

import os
import shutil
import signal
import subprocess
import sys
import tomllib
from contextlib import suppress
from itertools import islice
from pathlib import Path

import pytest
import yaml
from limits import SOON_S

from qmn import needs
from qmn.__main__ import described
from qmn.needs import Needs, needs_of
from topologies.system.processes.programs import NetworkError

ROOT = Path(__file__).resolve().parents[3]
QMN = ROOT / "bin" / "qmn"
AN_ORDINARY_USER = """
import os, runpy, sys
os.geteuid = lambda: 1000
sys.argv[0] = "qmn"
runpy.run_module("qmn", run_name="__main__", alter_sys=True)
"""
STRUCK_WHILE_IT_ENDS = """
import atexit, os, runpy, signal, sys
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
    atexit.register(os.kill, os.getpid(), number)
runpy.run_module("qmn", run_name="__main__", alter_sys=True)
"""


def run(*command: object, **options: object) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    words = [str(word) for word in command]
    return subprocess.run(  # type: ignore[call-overload, no-any-return]
        words, capture_output=True, text=True, check=False, timeout=SOON_S, **options
    )


def test_it_runs_from_anywhere_and_loads_nothing_that_lies_there(tmp_path: Path) -> None:
    (tmp_path / "argparse.py").write_text("raise SystemExit('a trap')")
    done = run(QMN, "sabot", "--help", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage: qmn sabot ")


def test_a_link_to_it_is_it(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(QMN)
    assert run(tmp_path / "link", "sabot", "--help").stdout.startswith("usage: qmn sabot ")


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_it_tells_its_name_and_version(tmp_path: Path) -> None:
    done = run(QMN, "--version", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"qmn {PROJECT['version']}\n"


def test_a_checkout_without_its_set_up_says_what_to_type(tmp_path: Path) -> None:
    (tmp_path / "bin").mkdir()
    for name in ("requirements.lock", "bin/qmn"):
        shutil.copy(ROOT / name, tmp_path / name)
    done = run(tmp_path / "bin" / "qmn", "doctor")
    assert done.returncode == 1
    assert done.stderr == (
        f"qmn: not set up yet (.venv is missing or too old). Type: make -C '{tmp_path}' setup\n"
    )


STEERS = (
    "run sdc|run qkd --eve 1|cli ring|devices|paths|spy|set policy reload|enter ls|"
    "set host alice fec golay|set fault q1 repair|"
    "set calibrate alice q1|set classical alice q1 1|set tap alice q1 0|lab bench|"
    "lab sweep sdc --emulate|lab published paper|lab published --all"
)
LOOKS = (
    "spy runs/latest|report runs/latest|replay runs/latest|wireshark|doctor|sabot run bell.qasm|"
    "lab sweep sdc|lab curves|lab|lab published|rootless run sdc"
)


@pytest.mark.parametrize("words", STEERS.split("|"))
def test_what_starts_or_steers_a_network_needs_root(words: str) -> None:
    assert needs_of(described(words.split()).parse_args(words.split())) is not Needs.NOTHING


@pytest.mark.parametrize("words", LOOKS.split("|"))
def test_what_looks_at_files_or_computes_does_not(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "runs" / "latest").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    assert needs_of(described(words.split()).parse_args(words.split())) is Needs.NOTHING


@pytest.mark.parametrize("words", ["--runs /run/new", "--runs {link}/new", "--policy {link}"])
def test_what_a_run_does_not_see_is_refused(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what lies in /run: results there would be lost."""
    (link := tmp_path / "link").symlink_to("/run")
    command = ["run", "sdc", *words.format(link=link).split()]
    monkeypatch.setattr(needs, "become_root", lambda _words: None)
    with pytest.raises(NetworkError, match="a run has a /run of its own"):
        needs.provide(described(command).parse_args(command), command)


def test_root_is_asked_of_sudo_with_the_very_same_words(tmp_path: Path) -> None:
    sudo = tmp_path / "sudo"
    sudo.write_text("#!/bin/sh\nprintf '%s\\n' \"$@\"\n")
    sudo.chmod(0o755)
    words = ["run", "sdc", "--message", "two words; $HOME"]
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = run(sys.executable, "-c", AN_ORDINARY_USER, *words, cwd=ROOT, env=environment)
    assert done.stdout.splitlines() == [str(QMN), *words]


def test_where_there_is_no_sudo_the_user_hears_so(tmp_path: Path) -> None:
    environment = {**os.environ, "PATH": str(tmp_path)}
    done = run(sys.executable, "-c", AN_ORDINARY_USER, "devices", cwd=ROOT, env=environment)
    assert done.returncode == 1
    assert done.stderr == (
        "qmn: this needs root, and there is no sudo: run it as root, or by `qmn rootless`\n"
    )


def install(prefix: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return run(ROOT / "setup" / "install", *words, env={**os.environ, "PREFIX": str(prefix)})


def files_of(folder: Path) -> set[str]:
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if not file.is_dir()}


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where it is installed."""
    folder = tmp_path_factory.mktemp("a prefix")
    done = install(folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "add " in done.stdout
    return folder


def completions(prefix: Path, *lines: str, where: Path) -> list[set[str]]:
    """Return how bash would complete the last word of each line; it may be empty."""
    script = 'source "$1"; shift; for line; do read -ra COMP_WORDS <<<"qmn $line"; '
    script += '[[ $line != *" " ]] || COMP_WORDS+=(""); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); '
    script += 'COMPREPLY=(); _shtab_qmn; echo "${COMPREPLY[@]}"; done'
    file = prefix / "share/bash-completion/completions/qmn"
    done = run("bash", "-c", script, "bash", file, *lines, cwd=where)
    return [set(line.split()) for line in done.stdout.splitlines()]


def test_installed_it_runs_and_is_completed(prefix: Path, tmp_path: Path) -> None:
    usage = run(prefix / "bin" / "qmn", "--help").stdout
    assert usage.startswith("usage: qmn [-h] [--version] VERB")
    name = "20260101T100000-sdc"
    (tmp_path / "runs" / name).mkdir(parents=True)
    (tmp_path / "README.md").touch()
    completed = {
        "--ver": "--version",
        "set cal": "calibrate",
        "run tele": "teleport",
        "report READ": "README.md",
        "report 2026": name,
        "runs compare 2026": name,
        "spy runs/20": f"runs/{name}",
    }
    found = completions(prefix, *completed, "run sdc --controller ", where=tmp_path)
    assert found == [*({word} for word in completed.values()), {"ryu", "os-ken"}]
    page = (prefix / "share/man/man1/qmn.1").read_text()
    assert "qmn \\- the Mininet for programmable quantum networks" in page
    assert "qmn run teleport" in page
    assert "change a running network:\n  send " in page
    assert "\n  hom                  Hong" in page  # what can be swept, which is no argument's help
    assert page.splitlines()[0].split(" ", 4)[-1] == f'"qmn {PROJECT["version"]}" "User Commands"'
    assert "\n\\fB\\-\\-version\\fR\n" in page
    assert (prefix / "share/zsh/site-functions/_qmn").read_text().startswith("#compdef qmn\n")


def test_uninstalled_nothing_of_it_is_left(prefix: Path, tmp_path: Path) -> None:
    copied = shutil.copytree(prefix, tmp_path / "copied", symlinks=True)
    assert len(files_of(copied)) == 4
    assert install(copied, "--remove").returncode == 0
    assert files_of(copied) == set()


@pytest.mark.parametrize("words", [[], ["--remove"]])
def test_the_command_of_somebody_else_is_left_alone(tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "qmn").write_text("theirs")
    done = install(tmp_path, *words)
    assert done.returncode == 1
    assert "is not of this checkout" in done.stderr
    assert (tmp_path / "bin" / "qmn").read_text() == "theirs"


# The fields of the Citation File Format 1.2.0, by its schema (citation-file-format/schema.json).
CITED = """
abstract authors cff-version commit contact date-released doi identifiers keywords license
license-url message preferred-citation references repository repository-artifact repository-code
title type url version"""
PERSON = """address affiliation alias city country email family-names fax given-names name-particle
name-suffix orcid post-code region tel website"""
ENTITY = """address alias city country date-end date-start email fax location name orcid post-code
region tel website"""


def test_the_citation_has_the_fields_that_the_format_knows() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"authors", "cff-version", "message", "title"} <= citation.keys() <= set(CITED.split())
    assert citation["cff-version"] == "1.2.0"
    assert citation["version"] == PROJECT["version"]
    assert citation["type"] in ("software", "dataset")
    (paper,) = citation["references"]
    assert {"authors", "title", "type"} <= paper.keys()
    assert (paper["type"], paper["year"]) == ("article", 2016)
    for author in (*citation["authors"], *paper["authors"]):
        assert author.keys() <= set((ENTITY if "name" in author else PERSON).split())
    assert [each["family-names"] for each in paper["authors"]] == [
        "Dasari",
        "Sadlier",
        "Prout",
        "Williams",
        "Humble",
    ]
    assert paper["identifiers"] == [{"type": "other", "value": "arXiv:1604.01276"}]


def test_signals_after_the_last_word_change_nothing(tmp_path: Path) -> None:
    listed = "runs", "--runs", tmp_path, "--json"
    done = run(sys.executable, "-c", STRUCK_WHILE_IT_ENDS, *listed, cwd=ROOT)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "[]", "")


@pytest.mark.parametrize("after_s", [0.002 * 1.6**n for n in range(11)])  # to 0.2 s
def test_ctrl_c_while_it_loads_ends_it_without_a_traceback(after_s: float) -> None:
    struck = list(islice(filter(None, (struck_after(after_s) for _ in range(20))), 1))
    # Of Python, or of the script before it.
    assert struck in ([(-signal.SIGINT, b"")], [(130, b"")])


def struck_after(after_s: float) -> tuple[int, bytes] | None:
    """Return status and errors of a command; None if it had ended, as on a busy machine."""
    pipe = subprocess.PIPE
    command = [str(QMN), "run", "--help"]
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, start_new_session=True) as process:
        with suppress(subprocess.TimeoutExpired):
            process.wait(after_s)
        has_ended = process.poll() is not None
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=SOON_S)
        return None if has_ended else (process.returncode, errors)
