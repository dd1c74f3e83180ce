"""Tables of scripts in notebooks and as data frames, and those of sweeps as Parquet."""

import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from pyarrow import parquet
from recorded_run import run_of, teleported

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.estimates import Estimate
from evidence.curves.parquet import write_parquet
from evidence.curves.table import opened
from qmn.scripting.exchange import Exchange
from qmn.scripting.job_result import JobResult
from qmn.scripting.light import Hop, LightPath
from qmn.scripting.network import Held, HostState
from qmn.scripting.tables import TableOf, drawn
from views.report.drawing import VARIABLES
from views.report.markup import STYLE
from wire.outcomes import Pauli
from wire.results.figures import TeleportFigures
from wire.results.run_result import NetworkFacts, ServiceJob

EXCHANGE = Exchange(b"<secret>", 8, 0.25, 0.5, 4000, 1000, 3000, 30, 2)
PATH = LightPath(
    "00000000000000aa",
    (
        Hop("fibre", "alice-q0", "q1:3", 1.5, 0.3, Pauli.I),
        Hop("q1", "q1:3", "q1:5", 0.0, 0.5, Pauli.X),
    ),
)


def test_an_exchange_is_a_row_of_numbers_without_its_bytes() -> None:
    (row,) = EXCHANGE.rows()
    assert (row["bell_pairs"], row["loss"], row["symbol_error_rate"]) == (4000, 0.25, 0.01)
    assert (row["pairs_per_s"], row["bits_per_s"]) == (8000.0, 128.0)
    assert "data" not in row


def test_a_light_path_is_a_row_for_each_hop() -> None:
    other = replace(PATH, session="00000000000000bb")
    rows = TableOf([PATH, other]).rows()
    assert [(row["session"][-2:], row["what"], row["rotation"]) for row in rows] == [  # type: ignore[index]
        ("aa", "fibre", "I"),
        ("aa", "q1", "X"),
        ("bb", "fibre", "I"),
        ("bb", "q1", "X"),
    ]


def test_a_host_is_a_row_for_each_block_that_it_holds() -> None:
    device = {"name": "bob", "memory": 64, "settings": {"fec": "golay"}}
    blocks = Held("00000000000000aa", 1, 0, 100, "memory"), Held("00000000000000aa", 2, 1, 9, "q0")
    state = HostState(device, blocks)
    assert list(state.to_dataframe()["photons"]) == [100, 9]
    assert [(row["name"], row["memory"], row["place"]) for row in state.rows()] == [
        ("bob", 64, "memory"),
        ("bob", 64, "q0"),
    ]
    assert "<td>memory</td>" in state._repr_html_()
    assert blocks[0].rows() == [{**vars(blocks[0])}]
    (row,) = HostState(device, ()).rows()
    assert (row["name"], row["photons"]) == ("bob", None)


def test_a_notebook_shows_a_table_and_no_html_of_others() -> None:
    shown = TableOf([replace(PATH, session="<b>")])._repr_html_()
    assert shown.count("<tr>") == 3
    assert "&lt;b&gt;" in shown
    assert "4,000" in EXCHANGE._repr_html_()
    assert "<secret>" not in EXCHANGE._repr_html_()
    assert "<tr></tr>" in TableOf([])._repr_html_()


def test_a_figure_has_its_colours_with_it() -> None:
    shown = drawn("<svg/>", STYLE.read_text())
    for name in VARIABLES.values():
        assert f"--{name}: #" in shown, name


def job_of(figures: TeleportFigures) -> JobResult:
    """Return the result of a teleportation between alice and bob, on a network without fibres."""
    result = run_of("teleport", ServiceJob(asking=figures, asked=figures), 1.0)
    network = NetworkFacts(addresses={}, source="", fibers=[], switches=[], copper=[])
    return JobResult(**{**vars(result), "network": network, "delivered": True})


def test_a_job_has_its_sentence_and_its_picture_as_a_file_of_its_own() -> None:
    """Six states of which 9 in 10 agree: fidelity .9; SVG that no page gives a colour."""
    result = job_of(teleported(fidelity=0.9, of_states=[[10, 9]] * 6))
    svg = ElementTree.fromstring(result.svg())  # noqa: S314 (ours)
    assert svg.tag == "{http://www.w3.org/2000/svg}svg"
    assert "var(" not in result.svg()
    shown = result._repr_html_()
    assert "fidelity 0.9" in shown
    assert shown.index("<svg") < shown.index("<table")


def test_a_job_without_a_picture_says_so() -> None:
    result = job_of(teleported())
    assert "<svg" not in result._repr_html_()
    with pytest.raises(ValueError, match="teleport has no picture"):
        result.svg()


def test_a_data_frame_has_the_rows() -> None:
    frame = TableOf([EXCHANGE, replace(EXCHANGE, bell_pairs=8000)]).to_dataframe()
    assert frame["loss"].tolist() == [0.25, 0.125]
    assert frame["received_symbols"].dtype.kind == "i"


def test_without_pandas_the_error_names_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="make notebooks"):
        EXCHANGE.to_dataframe()


def test_parquet_has_what_the_table_has(tmp_path: Path) -> None:
    """Types as in the experiment; a theory that there is not is null."""
    teleport = EXPERIMENTS["teleport"]
    with opened(tmp_path / "teleport.csv", teleport) as table:
        for fidelity in (0.5, 0.75):
            values = teleport.complete({"fidelity": fidelity})
            table.add(values, 7, {"teleported": Estimate(fidelity / 2, 0.125)})
        file = write_parquet(table.path)
    assert file == tmp_path / "teleport.parquet"
    columns = parquet.read_table(file).to_pydict()
    assert columns["seed"] == [7, 7]
    assert columns["fidelity"] == [0.5, 0.75]
    assert columns["teleported"] == [0.25, 0.375]
    # Of a Werner pair: (2 F + 1) / 3.
    assert columns["teleported_theory"] == pytest.approx([2 / 3, 2.5 / 3])


def test_without_pyarrow_there_is_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert write_parquet(tmp_path / "any.csv") is None
    assert not list(tmp_path.iterdir())
