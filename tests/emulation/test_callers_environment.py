"""The environment of what people start by qmn, and whose is what that leaves: their own."""

import json
import os
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT
from limits import SOON_S

from qmn.results.run_folder import give_tree

QMN = str(ROOT / "bin" / "qmn")
# Variables that qmn would set: one of them is somebody's own with another value, one with the same.
SET_BY_QMN = (ROOT / "topologies" / "environment").read_text()
NAMES = {line.partition("=")[0] for line in SET_BY_QMN.splitlines() if not line.startswith("#")}
OWN = {"MALLOC_ARENA_MAX": "3", "OPENBLAS_NUM_THREADS": "1"}
CALLER = {**OWN, "PATH": os.environ["PATH"], "PYTHONPATH": "/callers/own", "FAVOURITE": "a b=c"}
BY_SHELLS = {"PWD", "OLDPWD", "SHLVL", "_", "LC_CTYPE"}
OF_A_PROGRAM = 'py open(f"/proc/{network.runtime.programs[0].pid}/environ").read().split(chr(0))'


def called(*words: str, text: str = "") -> str:
    """Return what bin/qmn says, in the environment of the caller and no other."""
    done = subprocess.run(
        [QMN, *words],
        input=text,
        env=CALLER,
        cwd="/",
        capture_output=True,
        text=True,
        timeout=SOON_S,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def environment(printed: str) -> dict[str, str]:
    """Return what env(1) has printed."""
    pairs = (line.partition("=") for line in printed.splitlines() if "=" in line)
    return {name.strip(): value for name, _, value in pairs}


def test_a_script_has_the_environment_of_who_runs_it(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("import json, os; print(json.dumps(dict(os.environ)))")
    found = json.loads(called("script", str(file)))
    assert CALLER.items() - {("PYTHONPATH", "/callers/own")} <= found.items()
    assert found["PYTHONPATH"] == str(ROOT)  # scripts find our packages
    assert found.keys() - CALLER.keys() <= BY_SHELLS


def test_shells_of_hosts_have_the_environment_of_the_caller(tmp_path: Path) -> None:
    assert OWN.keys() < NAMES
    popen = 'py alice.pexec("env")[0].replace(chr(10), chr(13))'
    commands = f"alice env\nsh echo\n{popen}\nsh echo; env -u PATH\n{OF_A_PROGRAM}\n"
    words = ["cli", "sdc", "--runs", str(tmp_path)]
    host, started, machine = called(*words, text=commands).rsplit("\n\n", 2)
    of_host, of_machine = environment(host), environment(machine)
    of_started = environment(started.replace("\\r", "\n"))
    for found in (of_host, of_started, of_machine):
        assert {name: found[name] for name in NAMES & found.keys()} == OWN
        assert found["FAVOURITE"] == "a b=c"
        assert not [name for name in found if name.startswith("QMN_CALLER")]
    assert of_host["PYTHONPATH"] == of_started["PYTHONPATH"] == str(ROOT)
    assert of_machine["PYTHONPATH"] == "/callers/own"
    for line in SET_BY_QMN.splitlines():  # our own programs have ours
        assert line.startswith("#") or repr(line) in machine


def test_what_a_run_leaves_is_of_who_has_called_sudo_but_not_what_its_links_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A host's root could leave a link there to a file of this machine's root."""
    monkeypatch.setenv("SUDO_UID", "65534")
    monkeypatch.setenv("SUDO_GID", "65534")
    roots = tmp_path / "of root"
    roots.write_text("secret")
    folder = tmp_path / "runs" / "one"
    (folder / "deep").mkdir(parents=True)
    (folder / "log").write_text("text")
    for link, target in (("link", roots), ("deep/folder", tmp_path)):
        (folder / link).symlink_to(target)
    give_tree(folder)
    given = (folder, folder / "log", folder / "link", folder / "deep" / "folder")
    assert {path.lstat().st_uid for path in given} == {65534}
    assert {path.stat().st_uid for path in (roots, tmp_path)} == {0}
