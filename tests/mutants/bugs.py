"""The bugs of *.toml here: of each a file, a snippet that is in it once, and the wrong one.

[[bug]]
file = "wire/qkd.py"
old = "len(data) < HEADER.size"
new = "len(data) <= HEADER.size"
explained = "why no test can notice it"  # if none does
"""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


@dataclass(frozen=True)
class Bug:
    """One plausible slip."""

    file: str
    old: str
    new: str
    explained: str = ""

    def __str__(self) -> str:
        return f"{self.file}: {self.old}  ->  {self.new}"

    @property
    def room(self) -> str:
        """The folder of the product that has it."""
        return self.file.partition("/")[0]

    def fits(self, root: Path) -> bool:
        """Return whether its snippet is in its file once."""
        file = root / self.file
        return file.exists() and file.read_text().count(self.old) == 1

    def applied(self, text: str) -> str:
        """Return the file's text with it."""
        return text.replace(self.old, self.new)


def bugs() -> list[Bug]:
    """Return all of them, room by room."""
    files = sorted(HERE.glob("*.toml"))
    return [Bug(**each) for file in files for each in tomllib.loads(file.read_text())["bug"]]


def unit_tests_of(bug: Bug, root: Path) -> list[str]:
    """Return the unit tests that import the file of a bug, then others that import its folder.

    A test imports what its scene imports.
    """
    package, _dot, name = bug.file.removesuffix(".py").replace("/", ".").rpartition(".")
    of_file = rf"^(from|import) {package}\.{name}\b|^from {package} import .*\b{name}\b"
    of_folder = rf"^(from|import) {package}\b"
    texts = {file: file.read_text() for file in (root / "tests" / "unit").rglob("*.py")}

    def importing(pattern: str) -> list[Path]:
        found = sorted(file for file, text in texts.items() if re.search(pattern, text, re.M))
        scenes = "|".join(file.stem for file in found if not file.stem.startswith("test_"))
        beside = importing(rf"^from ({scenes}) import") if scenes else []
        return [file for file in found if file.stem.startswith("test_")] + beside

    near = importing(of_file) + importing(of_folder)
    return [str(file.relative_to(root)) for file in dict.fromkeys(near)]
