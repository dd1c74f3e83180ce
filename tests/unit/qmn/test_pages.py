"""README and docs: commands that there are, links that lead somewhere, outputs as they are printed.

Those that need a network are in tests/emulation/test_documentation.py.
"""

import re
import runpy
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from documentation import NAMES, ROOT, blocks, commands, without_numbers
from limits import SOON_S

from qmn.__main__ import described

QMN = ROOT / "bin" / "qmn"
MAKEFILE = (ROOT / "Makefile").read_text()
FOLDERS = (
    *(
        "wire",
        "programs",
        "hosts",
        "controller_apps",
        "qswitch_agent",
        "dispatcher",
        "copper",
        "gate",
    ),
    *(
        "topologies",
        "qmn",
        "applications",
        "evidence",
        "views",
        "docs",
        "examples",
        "labs",
        "tests",
        "setup",
        "docker",
        "bin",
    ),
)
PATH = re.compile(rf"(?<![\w./-])((?:{'|'.join(FOLDERS)})/[\w./-]*\w/?)(?![\w*<])")
ADDED_BY_READERS = ("hosts/middleware/services/coin.py", "tests/unit/a/")
CALLS = [(name, " ".join(words)) for name in NAMES for words in commands(name, "qmn")]


def understood(words: list[str]) -> bool:
    """Return whether the command line takes these words; --help is one that ends it at once."""
    try:
        described(words).parse_args(words)
    except SystemExit as ended:
        return ended.code == 0
    return True


def test_every_qmn_command_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for run in ("latest", "20261122T015233-sdc"):
        (tmp_path / "runs" / run).mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    for name in NAMES:
        for words in commands(name, "qmn"):
            assert understood(words), f"qmn {' '.join(words)}: {capsys.readouterr().err}"


def test_commands_are_found() -> None:
    assert len(CALLS) > 60
    assert len({name for name, _words in CALLS}) > 12


def test_every_make_command_has_a_target() -> None:
    for name in NAMES:
        for words in commands(name, "make"):
            targets = [word for word in words if "=" not in word]
            for target in targets:
                assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE), f"{name}: make {target}"
            for variable in [word.partition("=")[0] for word in words if "=" in word]:
                assert f"  {variable}=" in MAKEFILE, f"{name}: {variable}="


def test_every_link_and_every_file_that_is_named_is_there() -> None:
    for name in NAMES:
        text = (ROOT / name).read_text()
        for link in re.findall(r"\]\(([^)#:]+)(?:#[\w-]+)?\)", text):
            assert (ROOT / name).parent.joinpath(link).exists(), f"{name}: {link}"
        for file in re.findall(PATH, text):
            if file not in ADDED_BY_READERS:
                assert (ROOT / file).exists(), f"{name}: {file}"


def test_paths_are_found_inside_commands_and_blocks() -> None:
    text = "`python -m pytest tests/unit/a.py -k x`\n  sudo docker/run\n[x](../wire/b.md) copper/c/"
    assert re.findall(PATH, text) == ["tests/unit/a.py", "docker/run", "copper/c/"]


def test_every_page_begins_with_who_needs_it() -> None:
    for name in [name for name in NAMES if name.startswith("docs/")]:
        title, blank, first = (ROOT / name).read_text().splitlines()[:3]
        assert title.startswith("# "), name
        assert blank == "", name
        assert first.startswith("For anyone who "), name


def test_each_line_of_a_page_is_known_to_the_tests_that_run_all_by_night() -> None:
    file = ROOT / "tests/commands/test_every_command.py"
    runpy.run_path(str(file))["test_each_excuse_is_needed"]()  # it raises where it is read, else


def test_every_page_is_in_the_readme_which_stays_short() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.split()) <= 900
    for name in NAMES:
        assert not name.startswith("docs/") or f"]({name})" in text, name


def changes(changelog: str) -> Iterator[tuple[str, str, list[str]]]:
    """Yield version, heading and entries of each section; raise if a line is none of these."""
    for version in changelog.split("\n## ")[1:]:
        name, *sections = version.split("\n### ")
        assert "\n" not in name.strip(), f"put entries under a heading: {name}"
        for heading, *lines in map(str.splitlines, sections):
            entries = [line for line in lines if line]
            for entry in entries:
                assert entry.startswith("- "), f"put an entry on one line: {entry}"
            yield name.strip(), heading, [entry.removeprefix("- ") for entry in entries]


def test_the_changelog_is_short_and_in_four_sections() -> None:
    words: Counter[str] = Counter()
    for version, heading, entries in changes((ROOT / "CHANGELOG.md").read_text()):
        assert heading in {"Added", "Changed", "Fixed", "Removed"}, version
        for entry in entries:
            assert len(entry.split()) <= 25, f"at most 25 words an entry: {entry}"
            words[version.split()[0]] += len(entry.split())
    assert 0 < words["0.1.0"] <= 1500


@pytest.mark.parametrize("spoiled", ["### Fixed\n\n- first\n  second", "- first\n\n### Fixed"])
def test_an_entry_on_two_lines_or_outside_of_a_section_is_found(spoiled: str) -> None:
    with pytest.raises(AssertionError, match=r"on one line:   second|under a heading"):
        list(changes(f"# Changelog\n\n## 1\n\n{spoiled}\n"))


def test_circuits_print_what_the_page_says(tmp_path: Path) -> None:
    typed = next(block for block in blocks("docs/circuits.md") if block.startswith("cat > bell"))
    (shown,) = blocks("docs/circuits.md", "text")
    first = typed.partition("--backend stim")[0].rpartition("\n")[0]
    done = subprocess.run(
        ["bash", "-ec", first.replace("qmn sabot", f"{QMN} sabot")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=SOON_S,
    )
    assert [line.rstrip() for line in done.stdout.splitlines()] == shown.splitlines()


def test_numbers_alone_are_taken_out_of_what_is_compared() -> None:
    printed = "pairs/s 1,234 (0.04 s)   \ncaptures /tmp/x y/runs/20261122T015233-sdc/*.pcap\n"
    assert without_numbers(printed) == "pairs/s N (N s)\ncaptures /tmp/x FOLDER/*.pcap"
