"""How long the rest takes: of the tests, and of the first set-up."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from progress import left

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("done", "total", "elapsed_s", "words"),
    [(50, 200, 60.0, "3 min"), (100, 200, 30.0, "30 s"), (199, 200, 1990.0, "10 s")],
)
def test_the_rest_is_expected_to_go_on_alike(
    done: int, total: int, elapsed_s: float, words: str
) -> None:
    assert left(done, total, elapsed_s) == words


def test_parts_are_added_up_with_what_they_have_started(tmp_path: Path) -> None:
    busy = "import time\nwhile time.process_time() < {}: pass"
    half = busy.format(0.6)  # with what pytest takes itself it is rounded up
    (tmp_path / "test_it.py").write_text(
        f"import subprocess, sys\ndef test_it(): subprocess.run([sys.executable, '-c', {half!r}])"
    )
    pytest_ = f"-p no:cacheprovider -p progress {tmp_path}"
    script = f"""
        source setup/part
        part style {sys.executable} -c '{busy.format(1.05)}'
        part none true
        {sys.executable} -m pytest {pytest_}
    """
    more = {"PYTHONPATH": str(ROOT / "tests"), "PARTS": "before=40"}
    done = subprocess.run(
        ["bash", "-euc", script],
        cwd=ROOT,
        env={**os.environ, **more},
        capture_output=True,
        text=True,
        check=True,
    )
    (line,) = re.findall(r"^processor: (\d+) s here, (.*); (\d+) s in all$", done.stdout, re.M)
    here, style = int(line[0]), re.fullmatch(r"before 40 s, style (\d+) s, none 0 s", line[1])
    assert style is not None
    assert min(here, int(style[1])) >= 1
    assert abs(int(line[2]) - 40 - here - int(style[1])) <= 1


UV = """#!/bin/sh
echo "index $UV_DEFAULT_INDEX, certificate $SSL_CERT_FILE"
echo 'Downloading a (6.8MiB)'
echo 'Downloading b (1.2MiB)'
echo 'Building c==1'
echo ' Downloaded b'
echo 'error: the server is away'
echo ' Downloaded a'
echo 'Installed 3 packages in 10ms'
echo ' + a==1'
exit $1
"""
PIP = """#!/bin/sh
test "$*" = '-m pip config list' || exit 9
echo "global.cert='/its/files.crt'"
echo "global.index-url='https://its.files/simple'"
"""


def installed(
    folder: Path, status: int = 0, every_s: str = "0", **report: str
) -> subprocess.CompletedProcess[str]:
    """Install by a uv that says and returns this, where a pip has files of its own."""
    (folder / ".venv" / "bin").mkdir(parents=True, exist_ok=True)
    for name, text in (("uv", UV.replace("$1", str(status))), ("python", PIP)):
        program = folder / ".venv" / "bin" / name
        program.write_text(text)
        program.chmod(0o755)
    ours = {key: value for key, value in os.environ.items() if not key.startswith(("PIP", "UV"))}
    return subprocess.run(
        [ROOT / "setup" / "python-packages", "a.lock"],
        cwd=folder,
        env={**ours, "EVERY_S": every_s, **report},
        capture_output=True,
        text=True,
        check=False,
    )


def test_set_up_tells_how_many_packages_are_left(tmp_path: Path) -> None:
    first, *progress, last = installed(tmp_path).stdout.splitlines()
    assert first == "setup: index https://its.files/simple, certificate /its/files.crt"
    assert progress == [
        "setup: 1 of 2 large Python packages fetched",
        "setup: error: the server is away",
        "setup: 2 of 2 large Python packages fetched",
    ]
    assert last == "setup: Installed 3 packages in 10ms"
    assert len(installed(tmp_path, every_s="1000").stdout.splitlines()) == 3  # not all the time


def test_set_up_looks_where_pip_has_been_told_to_look(tmp_path: Path) -> None:
    done = installed(tmp_path, PIP_INDEX_URL="https://mirror/simple", PIP_CERT="/ca.crt")
    assert done.stdout.startswith("setup: index https://mirror/simple, certificate /ca.crt\n")


def test_set_up_that_fails_says_so(tmp_path: Path) -> None:
    done = installed(tmp_path, status=2)
    assert done.returncode == 1
    assert done.stderr.startswith("setup: the packages of a.lock could not be installed; ")
