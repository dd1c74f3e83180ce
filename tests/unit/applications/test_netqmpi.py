"""NetQMPI programs, one for all ranks, with NetQMPI as it is; all ranks run in this process."""

from math import sqrt
from pathlib import Path
from typing import Any

import pytest
from netqasm.runtime.application import Application, ApplicationInstance
from netqasm_scene import performed, placed

from applications.netqasm.external import installed
from applications.netqasm.placement import Placement
from applications.netqasm.ranks import NothingToDo, counts
from applications.netqasm.rounds import simulate_application

PROGRAMS = Path(__file__).parent / "netqasm_styles" / "netqmpi"
LINE = {"rank_0": "alice", "rank_1": "charlie", "rank_2": "bob"}
LIGHT = [(1, 4), (5, 2)]  # from alice to charlie, and on from him to bob
SIGMAS = 4


def found(
    folder: Path, program: Path, rank: int, shots: int, **physics: Any
) -> tuple[dict[str, int], list[int]]:
    """Return what a rank has found, and the rounds in its output."""
    rounds: list[int] = []

    def perform() -> dict[str, int]:
        with installed(placed(folder, LINE), rounds.append):
            return counts(program, rank, len(LINE), shots)

    return performed(folder, perform, **physics), rounds


def test_states_are_passed_on_from_rank_to_rank(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """|1> and |+>: the last rank finds 1, and 0 along X, in every shot."""
    report, rounds = found(tmp_path, PROGRAMS / "passed_on.py", 2, 6, paths=LIGHT)
    assert report == {"01": 6}
    assert rounds == list(range(6))
    assert capsys.readouterr().out == "found {'01': 6}\n"  # its own rank begins last


@pytest.mark.nightly
def test_states_that_are_passed_on_are_as_good_as_the_pairs(tmp_path: Path) -> None:
    """Each of two bits is right in (1 + W) / 2, with W = (1 - p)^4 of two fibres a link."""
    w, shots = 0.3, 60
    words = {"paths": LIGHT, "depolarizing": 1 - w ** (1 / 4)}
    report, _rounds = found(tmp_path, PROGRAMS / "passed_on.py", 2, shots, **words)
    assert sum(report.values()) == shots
    expected = ((1 + w) / 2) ** 2
    bound = SIGMAS * sqrt(expected * (1 - expected) / shots)
    assert bound < 1 - expected  # without noise this would fail
    assert abs(report.get("01", 0) / shots - expected) < bound


def test_a_program_whose_ranks_make_no_circuit_is_told_so(tmp_path: Path) -> None:
    program = tmp_path / "nothing.py"
    program.write_text("def main(env=None):\n    with env.comm:\n        pass\n")
    with pytest.raises(NothingToDo, match="each of 3 ranks has to make one circuit"):
        found(tmp_path, program, 0, 1)


def test_no_other_network_is_simulated() -> None:
    placement = Placement({"rank_0": "alice"}, {"rank_0": "127.0.0.1"}, {"rank_0": None})
    nothing = ApplicationInstance(Application([], None), {}, None, {}, None)
    with pytest.raises(ValueError, match="the network is the one that runs"):
        simulate_application(placement, print, {}, nothing, network_cfg="network.yaml")
