"""The notebooks run from their first cell to the last, in networks and on the physical layer."""

from pathlib import Path

import nbclient
import nbformat
import pytest
from conftest import ROOT, nothing_left
from limits import PROGRAM_S

FOLDER = ROOT / "examples" / "notebooks"


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(file.stem for file in FOLDER.glob("*.ipynb")))
def test_a_notebook_runs_to_its_end(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It compares its results with theory itself; a cell that fails fails the test."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)  # as it is kept
    client = nbclient.NotebookClient(
        notebook,
        timeout=PROGRAM_S,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    )
    with nothing_left():
        client.execute()
    shown = [str(output) for cell in notebook.cells for output in cell.get("outputs", ())]
    if name == "first_network":
        assert any("<svg" in text for text in shown)
        assert any("<table" in text and "q1:" in text for text in shown)
