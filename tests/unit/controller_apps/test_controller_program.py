"""The controller as a program: what it refuses at its start, and a fault that ends it."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from limits import SOON_S

from topologies.system.runs.runtime import free_port
from wire.config import ControllerConfig

ROOT = Path(__file__).parents[3]


def test_an_unknown_framework_is_named_with_its_remedy(tmp_path: Path) -> None:
    config = tmp_path / "config.json"
    config.write_text('{"listen": "127.0.0.1:1", "framework": "pox"}')
    line = refused(config)
    assert "'pox'" in line
    assert "ryu, os-ken" in line


def test_an_unusable_address_is_named_with_its_remedy(tmp_path: Path) -> None:
    config = tmp_path / "config.json"
    config.write_text('{"listen": "localhost", "framework": "os-ken"}')
    assert "listen 'localhost' is not an address and a port" in refused(config)


@pytest.mark.parametrize(
    ("framework", "fields", "words"),
    [
        ("os-ken", {"rest": "127.0.0.1:8080"}, "os-ken has no WSGI server; use ryu"),
        ("ryu", {"rest": "8080"}, "rest '8080' is not an address and a port"),
        ("ryu", {"apps": ["ryu.app.ofctl_rest"]}, "serve HTTP: say where, by `rest`"),
        ("ryu", {"apps": ["ryu.app.none"]}, "apps: cannot load 'ryu.app.none' on ryu"),
        ("os-ken", {"policy": "/nowhere.toml"}, "cannot read the policy /nowhere.toml"),
        ("os-ken", {"state": "/nowhere/state"}, "cannot use the state folder '/nowhere/state'"),
        ("os-ken", {"console": "/nowhere/x.sock"}, "cannot open the console '/nowhere/x.sock'"),
    ],
)
def test_what_a_framework_cannot_do_is_named_at_the_start(
    tmp_path: Path, framework: str, fields: dict[str, Any], words: str
) -> None:
    port = free_port()
    config = tmp_path / "config.json"
    ControllerConfig(f"127.0.0.1:{port}", framework, **fields).write(config)
    assert words in refused(config)


def test_a_missing_configuration_is_named(tmp_path: Path) -> None:
    assert str(tmp_path / "none.json") in refused(tmp_path / "none.json")


def refused(config: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "controller_apps", "--config", str(config)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    return line


BROKEN = """
import sys
from pathlib import Path
from typing import Any
from controller_apps import __main__ as launcher
from controller_apps.sessions import arbiter
from wire.config import ControllerConfig

def broken(self, now):
    raise RuntimeError("the tick is broken")

arbiter.Arbiter.tick = broken
launcher.logging.basicConfig()
launcher.run(ControllerConfig.read(Path(sys.argv[1])))
"""


@pytest.mark.parametrize("framework", ["ryu", "os-ken"])
def test_a_fault_in_a_handler_ends_the_program(framework: str, tmp_path: Path) -> None:
    port = free_port()
    config = tmp_path / "config.json"
    ControllerConfig(f"127.0.0.1:{port}", framework).write(config)
    done = subprocess.run(
        [sys.executable, "-c", BROKEN, str(config)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout == "ready\n"
    assert "RuntimeError('the tick is broken')" in done.stderr
