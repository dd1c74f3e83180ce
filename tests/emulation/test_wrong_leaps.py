"""`make chaos LEAPS=N` counts the wrong leaps of a gate that makes some."""

import re
import subprocess

from limits import PROGRAM_S

from topologies.system.namespaces import OWN_NAMESPACES
from topologies.system.processes.programs import ROOT

LEAPS, CHAOS = 100, ROOT / "tests" / "chaos"


def test_leaps_are_wrong_of_a_gate_that_makes_them_while_programs_work() -> None:
    """A party computes for up to 3 ms, in which such a gate makes several."""
    script = "script", str(CHAOS / "leaps.py"), "--leaps", str(LEAPS)
    done = subprocess.run(
        [OWN_NAMESPACES, ROOT / "bin/qmn", *script, "--gate", CHAOS / "hasty_gate.py"],
        capture_output=True,
        text=True,
        check=False,
        timeout=PROGRAM_S,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    counted = re.search(r"^leaps ([\d,]+), wrong ([\d,]+)", done.stdout, re.MULTILINE)
    assert counted is not None, done.stdout + done.stderr
    leaps, wrong = (int(number.replace(",", "")) for number in counted.groups())
    assert leaps >= LEAPS
    assert wrong > 0
