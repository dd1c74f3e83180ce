"""The service that docs/adding-a-service.md adds, in a copy of the tree."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from limits import SOON_S

ROOT = Path(__file__).resolve().parents[3]
FOLDERS = ("wire", "programs", "hosts", "dispatcher", "qswitch_agent", "tests/unit/hosts")
PAGE = (ROOT / "docs" / "adding-a-service.md").read_text()
TRY = """
import json, sys
from pathlib import Path
from stacks_scene import ask

if __name__ == "__main__":
    print(json.dumps(ask(Path(sys.argv[1]), "coin", count=20_000)))
"""


def snippets() -> list[str]:
    """Return the code of the page's four steps, of which the second has two parts."""
    return re.findall(r"<!-- [a-z].*? -->\n```python\n(.*?)```", PAGE, re.DOTALL)


def insert(file: Path, anchor: str, text: str) -> None:
    """Put text behind the line that an anchor is in."""
    lines = file.read_text().splitlines(keepends=True)
    (place,) = (number for number, line in enumerate(lines) if line.strip().startswith(anchor))
    file.write_text("".join([*lines[: place + 1], text, *lines[place + 1 :]]))


def test_the_page_on_adding_a_service_adds_one(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    for folder in FOLDERS:
        shutil.copytree(ROOT / folder, tmp_path / folder)
    name, light, needs, code, entry = snippets()
    insert(tmp_path / "wire" / "metadata" / "vocabulary.py", "BB84 =", name)
    insert(tmp_path / "wire" / "services.py", "Service.DISTRIBUTE: PAIRS,", light)
    insert(tmp_path / "wire" / "services.py", "Service.DISTRIBUTE: {SOURCE", needs)
    services = tmp_path / "hosts" / "middleware" / "services"
    (services / "coin.py").write_text(code)
    registry = (services / "__init__.py").read_text()
    assert registry.count("for kind in (") == 1
    registry = registry.replace("for kind in (", "for kind in (coin.KIND, ")
    registry = registry.replace("from hosts", f"{entry}from hosts", 1)
    (services / "__init__.py").write_text(registry)

    sockets = tmp_path_factory.mktemp("coin")  # a short path, as sockets need
    scene = tmp_path / "tests" / "unit" / "hosts"
    (scene / "try_it.py").write_text(TRY)
    done = subprocess.run(
        [sys.executable, str(scene / "try_it.py"), str(sockets)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": f"{tmp_path}:{scene}:{ROOT / 'tests'}"},
        capture_output=True,
        text=True,
        check=False,
        timeout=SOON_S,
    )
    assert done.returncode == 0, done.stderr
    opener, _acceptor = json.loads(done.stdout)
    assert opener == {"coins": 20_000, "agreed": 20_000}
