"""Pages are short; the words of docs/ and of the product are plain, folder by folder."""

import re
from pathlib import Path

import pytest
from documentation import NAMES, ROOT

MOST_WORDS = 2500
# A folder, or a page beside them, enters when it is clean.
CLEAN = [
    *("dispatcher", "controller_apps", "qswitch_agent", "wire"),
    *("docs", "README.md", "SECURITY.md", "CONTRIBUTING.md"),
    *("hosts/middleware", "hosts/serving", "hosts/stack.py", "hosts/timeouts.py"),
    *("hosts/service_socket.py", "hosts/quantum_socket.py", "programs", "copper"),
    *("topologies/catalogue", "topologies/description", "topologies/links"),
    *("topologies/system/open_vswitch", "topologies/system/processes", "topologies/system/runs"),
    *("topologies/system/confinement", "topologies/fabric.py", "topologies/mapped.py"),
    *("topologies/quantum_topo.py", "topologies/timeouts.py", "views", "applications", "qmn"),
    *("evidence/attacks", "evidence/bench", "evidence/labs", "evidence/networks"),
    *("evidence/traffic", "evidence/kinds"),
]
BANNED = re.compile(
    r"\b(told|said|so many|what no|(come|comes|came) of|anew|whoever|as ever|nothing of what"
    r"|let \w+ have|is there)\b",
    re.IGNORECASE,
)
# A sentence that begins with its subject clause: "What no table has taken is dropped".
SUBJECT_CLAUSE = re.compile(r'(^|"""|(?<!#)# |[.!?;] |\| |- |\n\n)(What|Who) [a-z]')


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_at_most_2500_words(name: str) -> None:
    assert len((ROOT / name).read_text().split()) <= MOST_WORDS


def written(path: Path) -> list[Path]:
    """Return the pages and the Python files that people wrote, in a folder or a file."""
    files = [path] if path.is_file() else [*path.rglob("*.py"), *path.rglob("*.md")]
    return [file for file in files if "_pb2" not in file.name]


@pytest.mark.parametrize("name", CLEAN)
def test_sentences_and_names_are_plain(name: str) -> None:
    assert written(ROOT / name)
    for file in written(ROOT / name):
        # A line's end inside a sentence is a space, also behind the sign of a comment.
        text = re.sub(r"(?<!\n)\n[ #]*(?!\n)", " ", file.read_text())
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
