"""Reference pages describe all: options, settings, results, messages and the public API."""

import re

import pytest
import yaml
from documentation import ROOT

from views import api_reference, message_reference, reference
from views.comments import MEANINGS, meaning, of_fields
from wire import device
from wire.metadata.decoding import KINDS
from wire.parameters.physics import Memory

PAGES = {
    "docs/options.md": reference,
    "docs/messages.md": message_reference,
    "docs/api.md": api_reference,
}
ROW = re.compile(r"^\| (?!---)(.*) \|$", re.MULTILINE)


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return {name: module.page() for name, module in PAGES.items()}


def test_no_row_is_without_a_description(pages: dict[str, str]) -> None:
    for name, page in pages.items():
        rows = ROW.findall(page)
        assert len(rows) > 100
        for row in rows:
            assert row.rpartition(" | ")[2].strip(), f"{name}: {row}: describe it: {MEANINGS}"


def test_no_section_is_empty(pages: dict[str, str]) -> None:
    for name in ("docs/messages.md", "docs/api.md"):
        for title, text in re.findall(r"^### (.*)\n((?:(?!##).*\n?)*)", pages[name], re.MULTILINE):
            assert text.strip() or name == "docs/messages.md", f"{name}: {title}"


def test_every_message_and_every_public_name_is_there(pages: dict[str, str]) -> None:
    for kind in [*KINDS.values(), *device.kinds().values()]:
        assert f"\n### {kind.__name__} (kind {kind.KIND})\n" in pages["docs/messages.md"]
    for file in (ROOT / "wire").glob("*.proto"):
        text = re.sub(r"//.*", "", file.read_text())
        for message in re.findall(r"^message (\w+)", text, re.MULTILINE):
            assert f"\n### {message}\n" in pages["docs/messages.md"]
        for call in re.findall(r"^\s*rpc (\w+)", text, re.MULTILINE):
            assert f"\n| `{call}` |" in pages["docs/messages.md"]
        for field in re.findall(r"^\s+[\w. ]+ (\w+) = \d+;", text, re.MULTILINE):
            assert f"\n| `{field}` |" in pages["docs/messages.md"], field
    for module in api_reference.PUBLIC:
        for name in api_reference.public_names(module):
            assert f"\n### {name}\n" in pages["docs/api.md"]


def test_a_comment_is_that_above_and_that_behind() -> None:
    comments = of_fields(Memory)
    assert comments["efficiency"] == "of storing and reading together"
    assert comments["damping"].startswith("Where T2 > T1: approximate relaxation by Paulis, or")
    assert comments["t1_s"] == ""
    assert meaning(Memory, "t1_s") == "relaxation time"


def test_they_are_pages_of_the_site() -> None:
    text = (ROOT / "mkdocs.yml").read_text()
    assert yaml.safe_load(text)
    made = (ROOT / "setup" / "site" / "pages.py").read_text()
    for name, module in PAGES.items():
        assert f": {name}\n" in text
        assert f'"{name}": "{module.__name__}"' in made
