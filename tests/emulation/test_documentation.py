"""The commands of the README, run as it says, and of some pages; outputs as these print them."""

import re
import shlex
from pathlib import Path

import pytest
from conftest import ROOT
from documentation import blocks, commands, shell, without_numbers
from limits import PROGRAM_S


def bash(text: str, cwd: Path, typed: str = "") -> str:
    """Type text to a shell in a folder where `qmn` is on the PATH; return what it printed."""
    done = shell(text, cwd, typed, PROGRAM_S)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_first_command_prints_what_the_readme_says(tmp_path: Path) -> None:
    shown = next(block for block in blocks("README.md") if block.startswith("run-sdc"))
    printed = bash("qmn run sdc --seed 1", tmp_path)  # which `make run-sdc` is, when all is set up
    mode, printed_of_run = shown.split("\n", 1)  # setup/run-sdc, which also says the mode
    assert mode.startswith("run-sdc: mode ")
    lines = printed.splitlines(keepends=True)  # a busy machine starts for more than 5 s
    quick = "".join(line for line in lines if not line.startswith("still starting"))
    assert without_numbers(quick) == without_numbers(printed_of_run)
    assert "37 bytes, delivered exactly" in printed
    assert "Bell pairs used       148" in printed


COMMANDS = commands("README.md", "qmn")
# The last words of those that are long, by 100 hosts on a map, or in the walkthrough, too.
OF_NIGHT = {"mi1", "20000", "1000"}


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(words, marks=[pytest.mark.nightly] * (words[-1] in OF_NIGHT))
        for words in COMMANDS
    ],
    ids=" ".join,
)
def test_the_other_commands_of_the_readme_do_as_it_says(tmp_path: Path, words: list[str]) -> None:
    quoted = f"qmn {shlex.join(words)} --runs runs"
    if "--eve" in words:
        assert "no key: " in bash(f"! {quoted} 2>&1", tmp_path)
    else:
        bash(quoted, tmp_path, typed="alice qsend bob hello\n")
    assert (tmp_path / "runs" / "latest" / "result.json").exists()


def test_the_python_of_the_readme_runs_as_it_is(tmp_path: Path) -> None:
    (code,) = blocks("README.md", "python")
    (tmp_path / "first.py").write_text(code)
    printed = bash("qmn script first.py", tmp_path)
    assert "1 packets transmitted, 1 received" in printed
    assert re.search(r"^b'hello' \d+ \d+$", printed, re.MULTILINE)
    assert printed.count("['fibre', 'q1', 'fibre']") == 3


@pytest.mark.nightly
def test_a_replay_prints_what_the_page_says(tmp_path: Path) -> None:
    bash("qmn run sdc --depolarizing 0.001 --frame-bytes 32 --qasm", tmp_path)
    (shown,) = [block for block in blocks("docs/circuits.md") if "identical" in block]
    command, output = shown.splitlines()
    assert without_numbers(bash(command, tmp_path)) == without_numbers(output)
    assert "exact: true" in bash("qmn sabot run runs/latest/quantum.qasm --shots 1", tmp_path)


@pytest.mark.usefixtures("machines_open_vswitch")
def test_mininets_own_program_does_what_the_page_says(tmp_path: Path) -> None:
    (block,) = [each for each in blocks("docs/networks.md") if "mininet>" in each]
    mn = next(line for line in block.splitlines() if "mn --custom" in line)
    typed = [line.removeprefix("mininet> ") for line in block.splitlines() if "mininet>" in line]
    got = tmp_path / "got"
    commands = "\n".join([*(line.replace("/tmp/got", str(got)) for line in typed), "exit", ""])
    bash(f"{mn.removeprefix('sudo ')} 2>&1", ROOT, typed=commands)
    assert got.read_text() == "hello\n"
