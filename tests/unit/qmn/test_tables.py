"""Tables of scripts in notebooks and as data frames, and those of sweeps as Parquet."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from pyarrow import parquet

from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.estimates import Estimate
from evidence.curves.parquet import write_parquet
from evidence.curves.table import opened
from qmn.scripting.exchange import Exchange
from qmn.scripting.light import Hop, LightPath
from qmn.scripting.network import Held, HostState
from qmn.scripting.tables import TableOf, drawn
from views.report.drawing import VARIABLES
from views.report.page import STYLE
from wire.outcomes import Pauli

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
