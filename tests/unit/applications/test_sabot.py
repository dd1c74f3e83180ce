"""qmn sabot run, as a user types it."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import forked_python
import pytest
from limits import SOON_S

BELL = """OPENQASM 2.0;
include "qelib1.inc";
qreg q[2];
creg c[2];
h q[0];
cx q[0], q[1];
measure q -> c;
"""


def run(*words: str, program: str = "") -> subprocess.CompletedProcess[str]:
    """Run the command."""
    command = [sys.executable, "-m", "qmn", "sabot", "run", *words]
    return forked_python.run(command, SOON_S, program)


def test_counts_are_a_table_and_the_most_frequent_comes_first(tmp_path: Path) -> None:
    file = tmp_path / "bell.qasm"
    file.write_text(BELL)
    done = run(str(file), "--shots", "999", "--seed", "5")
    assert (done.returncode, done.stderr) == (0, "")
    first, heading, *rows = done.stdout.splitlines()
    assert first == "2 qubits, 999 shots, seed 5, backend chp, exact: true"
    assert heading.split() == ["c", "shots", "%"]
    assert {row.split()[0] for row in rows} == {"00", "11"}
    numbers = [int(row.split()[1]) for row in rows]
    assert numbers == sorted(numbers, reverse=True)
    assert sum(numbers) == 999


def test_json_has_everything() -> None:
    done = run("-", "--json", program=BELL)
    facts = json.loads(done.stdout)
    counts = facts.pop("counts")
    assert sum(counts.values()) == 1000
    assert facts == {
        "file": "-",
        "qubits": 2,
        "registers": {"c": 2},
        "shots": 1000,
        "seed": 1,
        "backend": "chp",
        "exact": True,
    }


def test_original_chp_programs_run(tmp_path: Path) -> None:
    file = tmp_path / "ghz.chp"
    program = "three\n#\nh 0\nc 0 1\nc 0 2\nm 0\nm 1\nm 2\n"
    file.write_text(program)
    named = json.loads(run(str(file), "--json").stdout)
    assert named["counts"].keys() == {"000", "111"}
    piped = json.loads(run("-", "--format", "chp", "--json", program=program).stdout)
    assert piped["counts"] == named["counts"]


@pytest.mark.parametrize(
    ("words", "program", "text"),
    [
        (["-"], BELL + "foo q[0];", "standard input:8:1: unknown gate 'foo'"),
        (["-", "--shots", "0"], BELL, "0 shots: choose 1 to 1,000,000"),
        (["-"], BELL + "t q[0];", "use the backend dense"),
        (["absent.qasm"], "", "cannot read absent.qasm: No such file"),
    ],
)
def test_an_error_is_one_line_and_a_status(words: list[str], program: str, text: str) -> None:
    done = run(*words, program=program)
    assert (done.returncode, done.stdout) == (1, "")
    assert text in done.stderr
    assert done.stderr.count("\n") == 1


def test_registers_that_are_too_wide_for_a_table_come_one_a_line() -> None:
    program = "OPENQASM 2.0; qreg q[120]; creg c[120]; creg d[2]; measure q -> c;"
    done = run("-", program=program)
    assert done.stdout.splitlines()[1:] == ["1,000 shots, 100.00 %", f"  c {'0' * 120}", "  d 00"]


def test_nothing_measured_says_so() -> None:
    done = run("-", program="OPENQASM 2.0; qreg q[1]; h q;")
    assert "nothing is measured" in done.stdout


def test_ctrl_c_ends_it_without_a_traceback(tmp_path: Path) -> None:
    pipe = tmp_path / "program.qasm"
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "qmn", "sabot", "run", str(pipe)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
        with pipe.open("wb"):  # opens when the program reads, which then waits for more
            program.send_signal(signal.SIGINT)
            assert program.wait(SOON_S) == -signal.SIGINT
        assert program.stderr
        assert program.stderr.read() == b""
