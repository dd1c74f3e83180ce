"""Pages are short; the words of docs/ and of the product are plain, folder by folder."""

import re
from pathlib import Path

import pytest
from documentation import NAMES, ROOT

MOST_WORDS = 2500
# Folders, and the pages beside them.
CLEAN = [
    *("dispatcher", "controller_apps", "qswitch_agent", "wire"),
    *("docs", "README.md", "SECURITY.md", "CONTRIBUTING.md"),
    *("hosts", "programs", "copper", "topologies", "gate"),
    *("views", "applications", "evidence", "qmn"),
    *("tests", "course", "examples", "labs", "setup", "docker", "CHANGELOG.md"),
]
WRITTEN = (".py", ".md", ".js", ".lua")
# The list itself, and what others wrote.
OF_OTHERS = ("test_words.py", "uPlot.esm.js", "shim.js")
BANNED = re.compile(
    r"\b(told|said|so many|what no|(come|comes|came) of|anew|whoever|as ever|nothing of what"
    r"|let \w+ have|is there)\b",
    re.IGNORECASE,
)
# A sentence that begins with its subject clause: "What no table has taken is dropped".
SUBJECT_CLAUSE = re.compile(r'(^|"""|(?<!#)# |// |-- |[.!?;] |\| |- |\n\n *)(What|Who) [a-z]')


def test_a_page_has_at_most_2500_words() -> None:
    for name in NAMES:
        assert len((ROOT / name).read_text().split()) <= MOST_WORDS, name


def written(path: Path) -> list[Path]:
    """Return the pages and the files of code that people wrote, in a folder or a file."""
    files = [path] if path.is_file() else [f for f in path.rglob("*") if f.suffix in WRITTEN]
    return [file for file in files if "_pb2" not in file.name and file.name not in OF_OTHERS]


@pytest.mark.parametrize("name", CLEAN)
def test_sentences_and_names_are_plain(name: str) -> None:
    assert written(ROOT / name)
    for file in written(ROOT / name):
        # A line's end inside a sentence is a space, also behind the sign of a comment.
        text = re.sub(r"(?<!\n)\n[ #/]*(?!\n)", " ", file.read_text())
        for banned in (BANNED, SUBJECT_CLAUSE):
            found = banned.search(text)
            assert found is None, (file, text[max(found.start() - 40, 0) : found.end() + 40])


@pytest.mark.parametrize(
    "text",
    ["it is told", "so many\npairs", "# It is so\n# many", "It ends. What is left stays.", "Anew"],
)
def test_a_banned_word_is_found_across_lines(text: str, tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    file.write_text(text)
    with pytest.raises(AssertionError):
        test_sentences_and_names_are_plain(str(file))
