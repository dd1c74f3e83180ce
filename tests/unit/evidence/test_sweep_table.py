"""A sweep goes on where it was interrupted."""

import csv
from pathlib import Path

import pytest

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.estimates import Estimate
from evidence.curves.experiment import Outcome
from evidence.curves.lines import BadTable
from evidence.curves.parameters import Values
from evidence.curves.table import opened
from evidence.networks.catalogue import EMULATED

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


@pytest.mark.parametrize(("name", "passed"), [("sdc", "arrived"), ("teleport", "teleported")])
def test_what_a_network_of_ones_own_is_not_told_is_empty(
    tmp_path: Path, name: str, passed: str
) -> None:
    """Its fibres have the length and the loss that its file says, not the defaults of a sweep."""
    experiment, path = EMULATED[name], tmp_path / "sweep.csv"
    outcome = {measure.name: Estimate(0.5, 0.1) for measure in experiment.measures}
    own: Values = {"topology": "mine.py:Lab"}
    given: list[Values] = [{}, own, {**own, "depolarizing": 0.02}]
    points = [experiment.complete(each) for each in given]
    with opened(path, experiment) as table:
        for values in points:
            table.add(values, SEED, outcome)
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert [row["depolarizing"] for row in rows] == ["0.0", "", "0.02"]
    assert [row[f"{passed}_theory"] == "" for row in rows] == [False, True, True]
    if name == "sdc":
        assert [row["length_km"] for row in rows] == ["0.01", "", ""]
    with opened(path, experiment) as table:
        assert [table.get(values, SEED) for values in points] == [outcome] * 3


def test_an_empty_value_of_the_network_that_is_told_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sweep.csv"
    experiment = EMULATED["teleport"]
    outcome = {measure.name: Estimate(0.5, 0.1) for measure in experiment.measures}
    with opened(path, experiment) as table:
        table.add(experiment.complete({"depolarizing": 0.02}), SEED, outcome)
    path.write_text(path.read_text().replace(",0.02,", ",,"))
    with (
        pytest.raises(BadTable, match="line 2: depolarizing is empty; remove"),
        opened(path, experiment),
    ):
        pass
