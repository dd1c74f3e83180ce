"""A sweep goes on where it was interrupted."""

from pathlib import Path

import pytest

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Outcome
from evidence.curves.lines import BadTable
from evidence.curves.parameters import Values
from evidence.curves.table import opened

TELEPORT = EXPERIMENTS["teleport"]
SEED = 1


def point(fidelity: float) -> tuple[Values, Outcome]:
    """Return a point and an outcome to know it by."""
    values = TELEPORT.complete({"fidelity": fidelity})
    return values, {"teleported": Estimate(fidelity / 3, 0.001)}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a table with two points."""
    path = tmp_path / "new" / "teleport.csv"
    with opened(path, TELEPORT) as table:
        for fidelity in (0.5, 0.7):
            values, outcome = point(fidelity)
            table.add(values, SEED, outcome)
            assert table.get(values, SEED) == outcome
    return path


def test_points_are_read_back_as_they_were(file: Path) -> None:
    with opened(file, TELEPORT) as table:
        for fidelity in (0.5, 0.7):
            values, outcome = point(fidelity)
            assert table.get(values, SEED) == outcome
        assert table.get(point(0.9)[0], SEED) is None
        assert not table.cut_off


def test_another_seed_is_another_point(file: Path) -> None:
    with opened(file, TELEPORT) as table:
        assert table.get(point(0.5)[0], SEED + 1) is None


@pytest.mark.parametrize("kept", [1, 10])
def test_a_half_written_last_line_is_cut_off_and_its_point_measured_again(
    file: Path, kept: int
) -> None:
    whole = file.read_bytes()
    last = whole.splitlines(keepends=True)[-1]
    file.write_bytes(whole[: len(whole) - len(last) + kept])
    with opened(file, TELEPORT) as table:
        assert table.cut_off
        assert table.get(point(0.5)[0], SEED) is not None
        values, outcome = point(0.7)
        assert table.get(values, SEED) is None
        table.add(values, SEED, outcome)
    assert file.read_bytes() == whole


def test_a_half_written_header_is_written_again(file: Path) -> None:
    whole = file.read_bytes()
    file.write_bytes(whole[:5])
    with opened(file, TELEPORT):
        pass
    assert file.read_bytes() == whole.splitlines(keepends=True)[0]


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda lines: ["a,b", *lines[1:]], "has other columns"),
        (lambda lines: [*lines, "1,0.5"], "line 4: 2 columns instead of 6; remove the line"),
        (lambda lines: [*lines, "1,7,200000,0.1,0.1,"], "line 4: fidelity '7'"),
        (lambda lines: [*lines, "x,0.5,200000,0.1,0.1,"], "line 4: invalid literal"),
    ],
)
def test_a_line_that_is_none_of_ours_is_named(file: Path, spoil: object, text: str) -> None:
    assert callable(spoil)
    spoiled = "\n".join(spoil(file.read_text().splitlines())) + "\n"
    file.write_text(spoiled)
    with pytest.raises(BadTable, match=text), opened(file, TELEPORT):
        pass
    assert file.read_text() == spoiled


def test_two_sweeps_do_not_write_to_one_table(file: Path) -> None:
    with (
        opened(file, TELEPORT),
        pytest.raises(BadTable, match="another qmn writes"),
        opened(file, TELEPORT),
    ):
        pass


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(BadTable, match="cannot write"), opened(tmp_path / "taken/x.csv", TELEPORT):
        pass
