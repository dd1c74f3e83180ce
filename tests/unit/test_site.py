"""The documentation as a site: its navigation, and pages that read alike there and on GitHub.

`make site` builds it, and ends with an error if a link or an anchor leads nowhere.
"""

import base64
import hashlib
import json
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from documentation import NAMES, ROOT

CONFIGURATION = yaml.safe_load((ROOT / "mkdocs.yml").read_text())
MADE = ["docs/options.md", "docs/messages.md", "docs/api.md"]  # of declarations, by views/
EVERY_PAGE = [*NAMES, "CHANGELOG.md"]
THEME = ROOT / "setup" / "site" / "theme"


def navigation(part: Any) -> Iterator[str]:
    """Yield the pages in a part of the navigation."""
    if isinstance(part, str):
        yield part
    else:
        for inner in part.values() if isinstance(part, dict) else part:
            yield from navigation(inner)


def test_every_page_is_in_the_navigation_once() -> None:
    named = list(navigation(CONFIGURATION["nav"]))
    assert set(EVERY_PAGE) <= set(named), "put it into `nav` of mkdocs.yml"
    assert sorted(named) == sorted([*EVERY_PAGE, *MADE])


def test_every_example_is_on_their_page() -> None:
    folder = ROOT / "examples"
    text = (folder / "README.md").read_text()
    for file in [*folder.glob("*.*"), *folder.glob("notebooks/*.ipynb")]:
        if file.suffix in {".py", ".toml", ".ipynb"}:
            assert f"]({file.relative_to(folder)})" in text, file


def test_examples_are_few_and_short() -> None:
    programs = [file for file in (ROOT / "examples").iterdir() if file.suffix in {".py", ".toml"}]
    assert 5 <= len(programs) <= 10
    for file in programs:
        assert 10 <= len(file.read_text().splitlines()) <= 60, file


def test_a_program_beside_the_documentation_is_in_the_folder_of_a_page_that_links_to_it() -> None:
    programs = list((ROOT / "docs").rglob("*.py"))
    assert programs
    for file in programs:
        folder = file.parent
        assert f"]({folder.name}/{file.name})" in folder.with_suffix(".md").read_text(), file


def test_nothing_is_loaded_from_elsewhere() -> None:
    assert CONFIGURATION["theme"]["font"] is False
    assert "offline" in CONFIGURATION["plugins"]
    for script in CONFIGURATION["extra"]["polyfills"]:
        assert (THEME / script).is_file()


def test_a_page_has_the_same_paragraphs_in_both_dialects() -> None:
    """In a list, Python-Markdown wants four blanks after an empty line, GitHub takes them too."""
    for name in EVERY_PAGE:
        text = re.sub(r"^```.*?^```", "", (ROOT / name).read_text(), flags=re.MULTILINE | re.DOTALL)
        for line in re.findall(r"\n\n( {1,3}\S.*)", text):
            pytest.fail(f"{name}: four blanks, or none: {line}")
        for line in re.findall(r"\n(?! |- |\d+\. |\||#|\n)[^\n]+\n((?:- |1\. |\|).*)", text):
            pytest.fail(f"{name}: an empty line before: {line}")


def test_the_shim_is_the_published_one() -> None:
    folder: Path = THEME / "iframe-worker"
    for name, text in json.loads((folder / "origin.json").read_text())["sha512"].items():
        digest = hashlib.sha512((folder / name).read_bytes()).digest()
        assert base64.b64encode(digest).decode() == text, name


def test_the_recording_is_in_asciinemas_format_and_of_the_machine_that_the_readme_shows() -> None:
    header, *events = map(json.loads, (ROOT / "docs/minute.cast").read_text().splitlines())
    assert (header["version"], header["width"]) == (2, 100)
    assert {kind for _seconds, kind, _text in events} == {"o"}
    shown = "".join(text for _seconds, _kind, text in events)
    assert set(re.findall(r"\S+/qmn/runs/", shown)) == {"/home/you/qmn/runs/"}
    assert "\x1b[1;32m$" in shown
    times = [seconds for seconds, _kind, _text in events]
    pauses = (later - earlier for earlier, later in pairwise([0, *times]))
    assert sum(min(each, header["idle_time_limit"]) for each in pauses) == pytest.approx(60, abs=5)
