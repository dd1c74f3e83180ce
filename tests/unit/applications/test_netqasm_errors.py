"""Errors of NetQASM programs name the role, the round and the line of the program."""

from pathlib import Path

import pytest
from netqasm_scene import performed, placed

from applications.netqasm.external import installed
from applications.netqasm.program import ProgramError, begin, load, located
from hosts.stack_socket import QuantumSocketError

PROGRAM = """\
from netqasm.sdk import Qubit
from netqasm.sdk.external import NetQASMConnection
from shared import step

def main(app_config=None, fails=0):
    with NetQASMConnection("alice", max_qubits=1) as unit:
        if fails == 1:
            both = Qubit(unit), Qubit(unit)
            unit.flush()
        elif fails == 2:
            step(unit)
"""


def error(folder: Path, fails: int) -> str:
    """Return the text of a program's error in its second round."""
    application = folder / "application"
    application.mkdir()
    (application / "app_alice.py").write_text(PROGRAM)
    (application / "shared.py").write_text("\ndef step(unit):\n    unit.nothing()\n")

    def perform() -> str:
        with installed(placed(folder, {"alice": "alice"})):
            with located("alice", application):
                main = load(application, "alice")
            with located("alice", application, 0):
                begin(main, "alice", "alice", {}, folder)
            caught = pytest.raises((QuantumSocketError, ProgramError))
            with caught as error, located("alice", application, 1):
                begin(main, "alice", "alice", {"fails": fails}, folder)
        return str(error.value)

    return performed(folder, perform)


def test_what_the_unit_refuses_is_at_the_line_that_sent_it(tmp_path: Path) -> None:
    text = error(tmp_path, fails=1)
    assert text.startswith("alice, round 2, app_alice.py, line 9: qubit 1: this application has 1")


def test_an_error_of_the_program_is_at_its_innermost_line(tmp_path: Path) -> None:
    text = error(tmp_path, fails=2)
    assert text.startswith("alice, round 2, shared.py, line 3: AttributeError: ")


def test_a_program_that_cannot_be_loaded_names_its_line(tmp_path: Path) -> None:
    (tmp_path / "app_bob.py").write_text("x = 1\nmissing_name\n")
    text = r"^bob, app_bob\.py, line 2: NameError: name 'missing_name' is not defined$"
    with pytest.raises(ProgramError, match=text), located("bob", tmp_path):
        load(tmp_path, "bob")
