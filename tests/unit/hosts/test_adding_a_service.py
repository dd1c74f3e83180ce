"""The service that docs/adding-a-service.md adds, by a package beside the tree."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from limits import SOON_S

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "adding-a-service.md").read_text()
TRY = """
import json, sys
from pathlib import Path
from stacks_scene import ask

if __name__ == "__main__":
    print(json.dumps(ask(Path(sys.argv[1]), "coin", count=20_000)))
"""
SERVICES = "import wire.services as w; print([each.name for each in w.LIGHT][-1])"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a folder with the page's files, installed as pip does it."""
    for name, text in re.findall(r"<!-- (coin/\S+) -->\n```\w+\n(.*?)```", PAGE, re.DOTALL):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    project = tomllib.loads((tmp_path / "coin" / "pyproject.toml").read_text())["project"]
    metadata = tmp_path / "coin-1.dist-info"
    metadata.mkdir()
    lines = list[str]()
    for group, entries in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in entries.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    return tmp_path


def python(package: Path, *words: str) -> subprocess.CompletedProcess[str]:
    folders = ROOT, package, ROOT / "tests" / "unit" / "hosts", ROOT / "tests"
    return subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": ":".join(map(str, folders))},
        capture_output=True,
        text=True,
        timeout=SOON_S,
    )


def test_the_page_on_adding_a_service_adds_one(
    package: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    sockets = tmp_path_factory.mktemp("coin")  # a short path, as sockets need
    (package / "try_it.py").write_text(TRY)
    done = python(package, str(package / "try_it.py"), str(sockets))
    assert done.returncode == 0, done.stderr
    opener, _acceptor = json.loads(done.stdout)
    assert opener == {"coins": 20_000, "agreed": 20_000}


def test_the_service_of_a_package_is_a_job(package: Path) -> None:
    usage = python(package, "-m", "qmn", "run", "coin", "--help").stdout
    assert "throw coins that two hosts have in common" in usage
    assert "--count" in usage


def test_a_package_that_cannot_be_loaded_is_named_and_left_out(package: Path) -> None:
    (package / "coin" / "service.py").write_text("import nowhere\n")
    done = python(package, "-c", SERVICES)
    assert done.stdout == python(ROOT, "-c", SERVICES).stdout
    assert "service coin (coin.service:COIN) is left out: No module named 'nowhere'" in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "refusal"),
    [
        ("number=100", "number=14", "two registered services have the number 14: remove one"),
        ('name="coin"', 'name="sense"', "two registered services have the name sense: remove one"),
        ("number=100", "number=1", "COIN -> SDC"),
    ],
)
def test_a_clash_of_services_is_refused(package: Path, old: str, new: str, refusal: str) -> None:
    module = package / "coin" / "service.py"
    module.write_text(module.read_text().replace(old, new))
    done = python(package, "-c", SERVICES)
    assert (done.returncode, refusal in done.stderr) == (1, True), done.stderr
