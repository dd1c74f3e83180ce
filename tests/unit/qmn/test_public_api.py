"""The public API: its modules are whole, and the declarations of services load little."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import qmn.services

ROOT = Path(__file__).resolve().parents[3]
PUBLIC = ("qmn.physics", "qmn.scripting", "qmn.services", "qmn.topology")
DECLARATION = """
import sys
from qmn.services import ABSORB, OPENER, PAIRS, Figures, RegisteredService
print(sorted({name.partition(".")[0] for name in sys.modules} & {"grpc", "hosts", "numpy"}))
"""
CORE = """
import sys
import qmn.__main__, qmn.physics, qmn.scripting, qmn.services, qmn.topology
import controller_apps.__main__, dispatcher.__main__, hosts.__main__, qswitch_agent.__main__
print(sorted({name.partition(".")[0] for name in sys.modules} & {"dask", "matplotlib", "scipy"}))
"""


@pytest.mark.parametrize("name", PUBLIC)
def test_each_public_name_is_there(name: str) -> None:
    module = importlib.import_module(name)
    names = getattr(module, "__all__", dir(module))
    assert len(names) >= 5
    for each in names:
        assert getattr(module, each) is not None


def test_services_refuses_a_name_that_its_stub_has_not() -> None:
    assert "RegisteredService" in dir(qmn.services)
    with pytest.raises(AttributeError, match=r"qmn\.services has no Servant"):
        _ = qmn.services.Servant  # type: ignore[attr-defined]


@pytest.mark.parametrize("program", [DECLARATION, CORE], ids=["declaration", "core"])
def test_a_declaration_loads_no_grpc_or_hosts_and_the_core_no_large_package(program: str) -> None:
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr


def test_the_package_says_that_it_has_types() -> None:
    assert (ROOT / "qmn" / "py.typed").exists()
