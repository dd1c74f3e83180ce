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
    (line,) = refused(config)
    assert "'pox'" in line
    assert "ryu, os-ken" in line


def test_an_unusable_address_is_named_with_its_remedy(tmp_path: Path) -> None:
    config = tmp_path / "config.json"
    config.write_text('{"listen": "localhost", "framework": "os-ken"}')
    (line,) = refused(config)
    assert "listen 'localhost' is not an address and a port" in line


@pytest.mark.parametrize(
    ("framework", "refusals"),
    [
        (
            "ryu",
            [
                ({"rest": "8080"}, "rest '8080' is not an address and a port"),
                ({"apps": ["ryu.app.ofctl_rest"]}, "serve HTTP: say where, by `rest`"),
                ({"apps": ["ryu.app.none"]}, "apps: cannot load 'ryu.app.none' on ryu"),
            ],
        ),
        (
            "os-ken",
            [
                ({"rest": "127.0.0.1:8080"}, "os-ken has no WSGI server; use ryu"),
                ({"policy": "/nowhere.toml"}, "cannot read the policy /nowhere.toml"),
                ({"state": "/nowhere/state"}, "cannot use the state folder '/nowhere/state'"),
                ({"console": "/nowhere/x.sock"}, "cannot open the console '/nowhere/x.sock'"),
            ],
        ),
    ],
)
def test_what_a_framework_cannot_do_is_named_at_the_start(
    tmp_path: Path, framework: str, refusals: list[tuple[dict[str, Any], str]]
) -> None:
    port = free_port()
    configs = [tmp_path / f"{number}.json" for number in range(len(refusals))]
    for config, (fields, _text) in zip(configs, refusals, strict=True):
        ControllerConfig(f"127.0.0.1:{port}", framework, **fields).write(config)
    lines = refused(*configs)
    for line, (_fields, text) in zip(lines, refusals, strict=True):
        assert text in line


def test_a_missing_configuration_is_named(tmp_path: Path) -> None:
    (line,) = refused(tmp_path / "none.json")
    assert str(tmp_path / "none.json") in line


# A framework takes longer to load than to be refused.
ONE_AFTER_ANOTHER = """
import sys
from controller_apps.__main__ import main
configs = sys.argv[1:]
for config in configs:
    sys.argv[1:] = ["--config", config]
    status = main()
    assert status == 1, (config, status)
sys.exit(status)
"""


def refused(*configs: Path) -> list[str]:
    """Return the line that each configuration is refused by."""
    done = subprocess.run(
        [sys.executable, "-c", ONE_AFTER_ANOTHER, *map(str, configs)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout == ""
    return done.stderr.splitlines()


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
