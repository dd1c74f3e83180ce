"""The bugs of *.toml here: of each file its snippets, which are in it once, and the wrong ones.

["applications/qkd/messages.py"]
"len(data) < HEADER.size" = "len(data) <= HEADER.size"
"right" = { new = "wrong", explained = "why no test can notice it" }
"one" = { new = "two", kind = "policy" }  # of those that once network tests alone noticed
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
    kind: str = ""
    test: str = ""  # the test by day that notices it, if none that imports its file does

    def __str__(self) -> str:
        old, new = (" ".join(text.split()) for text in (self.old, self.new))
        return f"{self.file}: {old}  ->  {new}"

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
    tables = (tomllib.loads(file.read_text()) for file in sorted(HERE.glob("*.toml")))
    return [
        Bug(file, old, **(new if isinstance(new, dict) else {"new": new}))
        for table in tables
        for file, snippets in table.items()
        for old, new in snippets.items()
    ]


def nearest_tests(bug: Bug, root: Path) -> tuple[list[str], list[str]]:
    """Return the tests that import the file of a bug, and others that import its folder.

    A test imports what its scene imports. First are those that are called like the file, then
    those of its room.
    """
    package, _dot, name = bug.file.removesuffix(".py").replace("/", ".").rpartition(".")
    of_file = rf"^(from|import) {package}\.{name}\b|^from {package} import .*\b{name}\b"
    of_folder = rf"^(from|import) {package}\b"
    folders = (root / "tests" / kind for kind in ("unit", "contract"))
    texts = {file: file.read_text() for folder in folders for file in folder.rglob("*.py")}

    def importing(pattern: str) -> list[str]:
        found = sorted(file for file, text in texts.items() if re.search(pattern, text, re.M))
        scenes = "|".join(file.stem for file in found if not file.stem.startswith("test_"))
        beside = importing(rf"^from ({scenes}) import") if scenes else []
        tests = [str(each.relative_to(root)) for each in found if each.stem.startswith("test_")]
        room = f"/{bug.room}/"
        return sorted(
            {*tests, *beside}, key=lambda each: (name not in each, room not in each, each)
        )

    near = importing(of_file)
    return near, [test for test in importing(of_folder) if test not in near]
