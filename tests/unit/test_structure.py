"""Who may import whom."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = (
    "wire",
    "dispatcher",
    "hosts",
    "controller_apps",
    "qswitch_agent",
    "copper",
    "topologies",
)
ALL = (*PRODUCT, "qmn", "tests")
GRPC = ("dispatcher", "hosts/hardware", "qswitch_agent", "qmn", "wire")


def imports(file: Path) -> Iterator[str]:
    """Yield the name of every module that a file imports, wherever it does so."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""


def sources(folder: str) -> list[Path]:
    """Return the files of a folder that people wrote."""
    return [file for file in (ROOT / folder).rglob("*.py") if "_pb2" not in file.name]


@pytest.mark.parametrize("folder", PRODUCT)
def test_a_product_folder_imports_only_wire_and_itself(folder: str) -> None:
    assert sources(folder)
    for file in sources(folder):
        ours = {name.split(".")[0] for name in imports(file)} & set(ALL)
        assert ours <= {"wire", folder}, file


@pytest.mark.parametrize("folder", [folder for folder in PRODUCT if folder != "topologies"])
def test_only_topologies_imports_mininet(folder: str) -> None:
    for file in sources(folder):
        assert "mininet" not in {name.split(".")[0] for name in imports(file)}, file


@pytest.mark.parametrize("folder", PRODUCT)
def test_grpc_stays_where_it_belongs(folder: str) -> None:
    for file in sources(folder):
        path = str(file.relative_to(ROOT))
        loads_grpc = any(name == "grpc" or name.endswith("_pb2_grpc") for name in imports(file))
        assert not loads_grpc or path.startswith(GRPC), file


def test_wire_imports_nothing_by_itself() -> None:
    assert list(imports(ROOT / "wire" / "__init__.py")) == []
