"""qmn lab sweep and qmn lab curves from the command line to table, figures and exit status."""

import argparse
import csv
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path

import matplotlib.image
import pytest
from distributed import LocalCluster

from evidence.curves import cluster, sheets, theory
from evidence.curves.parameters import BadGrid
from evidence.curves.sheets import Curve, Sheet
from evidence.kinds import sweep
from evidence.labs import rows as published
from evidence.labs.lab import Published, PublishedRow
from qmn.__main__ import described

POINTS = ("--fidelity", "0.5,0.75,1", "--pairs", "6000")
FIDELITY = 0.5
ALONE = ("--workers", "1")
Words = tuple[str, ...]


def parse(*words: str) -> argparse.Namespace:
    """Return what the command line says."""
    whole = ["lab", *words]
    arguments: argparse.Namespace = described(whole).parse_args(whole)
    return arguments


def run(*words: str) -> int:
    """Run a command and return its exit status."""
    arguments = parse(*words)
    status: int = arguments.call(arguments)
    return status


def rows(file: Path) -> list[list[str]]:
    """Return the lines of a table in an order of their own."""
    with file.open() as opened:
        return sorted(csv.reader(opened))


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Words]:
    """Name a cluster whose workers are here: to start processes takes longer than these sweeps."""
    with LocalCluster(
        n_workers=2,
        threads_per_worker=2,
        processes=False,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address=cluster.HTTP_ADDRESS,
        scheduler_kwargs={"dashboard": False},
        local_directory=tmp_path_factory.mktemp("dask"),
    ) as there:
        yield ("--scheduler", there.scheduler_address)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sweep with one worker."""
    folder = tmp_path_factory.mktemp("one")
    assert run("sweep", "teleport", *POINTS, "--out", str(folder), *ALONE) == 0
    return folder


def test_a_sweep_leaves_a_table_and_a_figure(swept: Path) -> None:
    table = rows(swept / "teleport.csv")
    assert len(table) == 4
    for line in table[:-1]:
        value, error, expected = map(float, line[-3:])
        assert expected == theory.teleported_fidelity(float(line[1]))
        assert abs(value - expected) < 5 * error
    picture = matplotlib.image.imread(swept / "teleport-teleported.png")
    assert picture.shape[0] > 400
    assert picture.std() > 0.05  # something is drawn


@pytest.mark.nightly
def test_two_workers_measure_the_same_as_one(swept: Path, tmp_path: Path) -> None:
    assert run("sweep", "teleport", *POINTS, "--out", str(tmp_path), "--workers", "2") == 0
    assert rows(tmp_path / "teleport.csv") == rows(swept / "teleport.csv")


def test_a_cluster_measures_the_same_as_processes(
    swept: Path, tmp_path: Path, scheduler: Words
) -> None:
    assert run("sweep", "teleport", *POINTS, "--out", str(tmp_path), *scheduler) == 0
    assert rows(tmp_path / "teleport.csv") == rows(swept / "teleport.csv")


def test_another_seed_measures_something_else(
    swept: Path, tmp_path: Path, scheduler: Words
) -> None:
    assert run("sweep", "teleport", *POINTS, "--seed", "2", *scheduler, "--out", str(tmp_path)) == 0
    values = [[line[-3] for line in rows(f / "teleport.csv")[:2]] for f in (swept, tmp_path)]
    assert values[0] != values[1]


def test_known_points_are_not_measured_again(
    swept: Path, tmp_path: Path, scheduler: Words, capsys: pytest.CaptureFixture[str]
) -> None:
    header, first, second, third = (swept / "teleport.csv").read_text().splitlines(keepends=True)
    cells = first.split(",")
    known = ",".join([*cells[:3], "0.123", *cells[4:]])  # values that no measurement gives
    table = tmp_path / "teleport.csv"
    table.write_text(header + known + second[:9])  # as a killed sweep leaves it
    assert run("sweep", "teleport", *POINTS, *scheduler, "--out", str(tmp_path)) == 0
    text = capsys.readouterr().out
    assert "3 points, seed 1; 1 are in" in text
    assert "its last line was half written" in text
    lines = table.read_text().splitlines(keepends=True)
    assert lines[:2] == [header, known]
    assert sorted(lines[2:]) == sorted([second, third])


def test_outputs_that_are_no_terminal_have_no_escape_codes(
    tmp_path: Path,
    scheduler: Words,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Jupyter's kernels set FORCE_COLOR."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert run("sweep", "teleport", *POINTS, *scheduler, "--out", str(tmp_path)) == 0
    assert "\x1b" not in capsys.readouterr().out


def test_points_of_other_grids_and_seeds_in_the_table_are_counted(
    swept: Path, tmp_path: Path, scheduler: Words, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "teleport.csv"
    table.write_text((swept / "teleport.csv").read_text())
    out = ("--out", str(tmp_path))
    assert run("sweep", "teleport", *POINTS, *scheduler, *out) == 0
    assert f"table    {table}\n" in capsys.readouterr().out
    other = ("--fidelity", "0.625", "--pairs", "6000", "--seed", "4")
    assert run("sweep", "teleport", *other, *scheduler, *out) == 0
    assert (
        f"table    {table}, with 3 points of other grids or seeds (--out: apart)\n"
        in capsys.readouterr().out
    )


def test_a_file_with_a_grid_is_swept_and_flags_come_first(tmp_path: Path, scheduler: Words) -> None:
    file = tmp_path / "grid.toml"
    file.write_text('sweep = "teleport"\nseed = 4\n[grid]\nfidelity = [0.5, 0.9]\npairs = 6000\n')
    out = ("--out", str(tmp_path))
    assert run("sweep", str(file), "--fidelity", "0.7", *scheduler, *out) == 0
    (line, _header) = rows(tmp_path / "teleport.csv")
    assert line[:3] == ["4", "0.7", "6000"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["nonsense"], "unknown sweep 'nonsense': choose one of sdc, teleport"),
        (["hom", "--emulate"], "unknown sweep 'hom' with --emulate: choose one of congestion"),
        (["hom", "--copper-mbps", "1"], "copper_mbps is not a parameter of hom"),
        (["hom", "--switches", "1"], "switches is not a parameter of hom"),
        (["teleport", "--fidelity", "0.1"], "fidelity '0.1': choose 0.25 to 1"),
        (["teleport", "--workers", "0"], "--workers 0: choose 1 to 256"),
        (["/nowhere.toml"], "cannot read /nowhere.toml"),
        (["sdc", "--emulate", "--pairs", "5000"], "sdc has no option pairs"),
        (["teleport", "--emulate", "--copper-mbps", "0"], "choose 0.001 to 10000 Mbit/s"),
        (["swap", "--switches", "255:260"], "257 quantum switches: choose 1 to 256"),
        (["swap", "--switches", "3:1"], "write the smaller one first, as 1:8"),
        (["swap", "--swiches", "1"], "swap has no option swiches: did you mean switches?"),
        (["swap", "--node.memory.t3_s", "1"], "memory has no t3_s: did you mean t2_s?"),
        (["swap", "--node.memory.t2_s", "1km"], "'1km': choose 1e-12 s or more"),
        (["swap", "--node.memory.t2_s", "0.1,0"], "node.memory.t2_s '0': choose 1e-12 s or more"),
        (["swap", "--x.memory.t2_s", "1"], "x: choose one of alice, bob, charlie"),
        (["swap", "--q1-qx.length_km", "1"], "no fibre q1-qx"),
        (["teleport", "--eve", "0.1"], "eve has no effect on teleport"),
        (["swap", "--schedule", "nestd"], "choose parallel, left-to-right, nested"),
    ],
)
def test_bad_input_is_refused_before_anything_runs(
    words: list[str], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    with pytest.raises(BadGrid) as caught:
        sweep.grid_of(sweep.options_of(parse("sweep", *words)))
    assert text in str(caught.value)
    assert run("sweep", *words, "--out", str(out)) == 1
    assert text in capsys.readouterr().err
    assert not out.exists()


def test_a_scheduler_that_is_not_there_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cluster, "CLUSTER_TIMEOUT_S", 0.5)
    words = ("--scheduler", "tcp://127.0.0.1:1", "--out", str(tmp_path))
    assert run("sweep", "teleport", *words) == 1
    assert "no Dask scheduler answers at tcp://127.0.0.1:1" in capsys.readouterr().err


@pytest.fixture
def one_sheet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let there be one small sheet."""
    curve = Curve("small", "Teleportation", "fidelity", "fidelity F", "teleported")
    axes: dict[str, object] = {"fidelity": [FIDELITY, 1.0], "pairs": 60_000}
    monkeypatch.setattr(sheets, "SHEETS", (Sheet("small", "teleport", axes, [curve]),))


@pytest.mark.usefixtures("one_sheet")
def test_curves_that_agree_with_theory_pass(tmp_path: Path, scheduler: Words) -> None:
    assert run("curves", "--only", "small", "--out", str(tmp_path), *scheduler) == 0
    assert matplotlib.image.imread(tmp_path / "small.png").std() > 0.05


@pytest.mark.usefixtures("one_sheet")
def test_a_point_that_theory_does_not_explain_fails_the_command_and_is_named(
    tmp_path: Path,
    scheduler: Words,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    # A theory that takes F for the fidelity of the teleported state: right for F = 1 alone.
    monkeypatch.setattr(theory, "teleported_fidelity", lambda fidelity: fidelity)
    assert run("curves", "--only", "small", "--out", str(tmp_path), *scheduler) == 1
    text = capsys.readouterr().err
    assert "teleport at fidelity 0.5, pairs 60000: teleported 0.66" in text
    assert "theory 0.5" in text
    assert text.count("more than 5 standard errors away") == 1


def test_a_point_at_which_nothing_could_be_measured_fails_the_command_and_is_named(
    tmp_path: Path,
    scheduler: Words,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """No decoy is sent without decoys."""
    curve = Curve("dark", "Decoys", "loss_db", "loss", "weak")
    axes: dict[str, object] = {"decoys": "off", "eve": "off", "pairs": 1000}
    monkeypatch.setattr(sheets, "SHEETS", (Sheet("dark", "photon-splitting", axes, [curve]),))
    assert run("curves", "--only", "dark", "--out", str(tmp_path), *scheduler) == 1
    assert "no weak was measured" in capsys.readouterr().err


@pytest.mark.nightly
@pytest.mark.timeout(400)  # half a minute of a processor
def test_every_published_figure_is_reproduced(
    tmp_path: Path,
    scheduler: Words,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The command itself: what papers and other programs state is what the row compares with."""
    monkeypatch.setenv("COLUMNS", "200")
    assert run("curves", "--only", "published", "--out", str(tmp_path), *scheduler) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert f"{len(published.rows())} published figures, 0 too far" in text
    for source in ("arXiv:1609.00713", "arXiv:1311.7129", "arXiv:2404.08626", "nature15759"):
        assert source in text
    assert not list(tmp_path.iterdir())  # no sheet was measured


def test_a_published_figure_that_is_not_ours_fails_the_command_and_is_named(
    tmp_path: Path,
    scheduler: Words,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Phi+ without noise has two bits a pair; 1.9 of them are ten errors off."""
    stated = Published(1.9, 0.01, "table I")
    row = PublishedRow("arXiv:1", "bits", stated, itemgetter("capacity"), [("sdc", {})])
    monkeypatch.setattr(published, "rows", lambda: [row])
    assert run("curves", "--only", "published", "--out", str(tmp_path), *scheduler) == 1
    output = capsys.readouterr()
    assert "+10.0 TOO FAR" in output.out
    assert "bits: 2.0000" in output.err
    assert "published 1.900 ± 0.010 (arXiv:1: table I)" in output.err


def test_unknown_curves_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("curves", "--only", "nothing", "--out", str(tmp_path)) == 1
    assert "--only nothing: choose one of superdense" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "shown", "hidden"),
    [
        (["sweep", "--help"], "\n  hom                  Hong-Ou-Mandel", "--depolarizing VALUES"),
        (["sweep", "sdc", "--help"], "--depolarizing VALUES", "--share VALUES"),
        (["sweep", "seal", "--help"], "seal: a tamper seal", "--fec VALUES"),
    ],
)
def test_help_of_an_experiment_is_of_its_parameters(
    words: list[str], shown: str, hidden: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(*words)
    output = capsys.readouterr().out
    assert ended.value.code == 0
    assert shown in output
    assert hidden not in output


SHEET = """
[[sheet]]
name = "links"
x = "load"
x_label = "load (erlang)"
grid = { load = [1.0, 2.0], links = [3] }
curves = [
    { file = "all", title = "All", measure = "through", marks = { "reduced loads" = [1.0] } },
    { title = "One", measure = "one_link", by = ["links"] },
]
"""


def test_curves_of_a_sheet_share_its_keys(tmp_path: Path) -> None:
    (file := tmp_path / "sheets.toml").write_text(SHEET)
    (sheet,) = sheets.read(file)
    assert (sheet.name, sheet.experiment, sheet.grid.size) == ("links", "links", 2)
    assert [curve.file for curve in sheet.curves] == ["all", "links"]
    assert {curve.x_label for curve in sheet.curves} == {"load (erlang)"}
    assert [mark.x for mark in sheet.curves[0].marks] == [1.0]
    assert not sheet.curves[1].marks


@pytest.mark.parametrize("place", ["x_label", "title"])
def test_a_key_that_no_sheet_has_is_refused(tmp_path: Path, place: str) -> None:
    (file := tmp_path / "sheets.toml").write_text(SHEET.replace(f"{place} =", "colour ="))
    with pytest.raises(BadGrid, match="colour"):
        sheets.read(file)


def test_a_busy_worker_of_this_machine_is_not_restarted() -> None:
    with cluster.local_client(0) as client:
        assert client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.worker_ttl) is None
