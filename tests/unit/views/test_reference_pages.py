"""Reference pages describe all: options, settings, results, messages and the public API."""

import re
from dataclasses import dataclass, fields

import pytest
import yaml
from documentation import ROOT

from views import api_reference, message_reference, reference
from views.comments import MEANINGS, meaning, of_fields
from wire import device
from wire.metadata.decoding import KINDS
from wire.parameters.fiber import SPEED_IN_FIBER_M_PER_S, FiberOptics
from wire.parameters.physics import Memory, choice, parameter
from wire.parameters.switch import QuantumSwitch

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


def test_no_setting_is_without_a_source(pages: dict[str, str]) -> None:
    _before, _title, settings = pages["docs/options.md"].partition("\n## Settings of devices")
    rows = ROW.findall(settings.partition("\n## ")[0])
    assert rows[0] == " | ".join(reference.SETTINGS)
    for row in rows:
        assert row.split(" | ")[4].strip(), f"{row}: name the source of its default"


def test_a_default_that_has_an_effect_needs_a_source() -> None:
    @dataclass
    class Part:
        loss_db: float = parameter(0.0, 0.0, 9.0)
        efficiency: float = parameter(1.0, 0.0, 1.0)
        rate_hz: float = parameter(1.0, 0.0, 9.0)
        bright: float = parameter(0.3, 0.0, 1.0)
        cited: float = parameter(0.3, 0.0, 1.0, source="a datasheet")
        kind: str = choice("good", "bad")

    sources = [reference.source_of(each) for each in fields(Part)]
    assert sources == ["ideal", "ideal", "", "", "a datasheet", ""]


def test_defaults_are_those_of_their_sources() -> None:
    """40 ps/(km K), 2e-9 /(km nm), 100 ns, and the grid: f = 193.1 THz + n 12.5 GHz, c = f l."""
    fiber, switch = FiberOptics(), QuantumSwitch("q1")
    kilometre_ps = 1e3 / SPEED_IN_FIBER_M_PER_S * 1e12
    assert kilometre_ps * fiber.thermal_ppm_per_k * 1e-6 == pytest.approx(40, rel=0.01)
    assert fiber.raman_per_km_nm == 2e-9
    assert switch.switching_time_s == 100e-9
    frequency_thz = 299_792.458 / fiber.filter_center_nm
    assert frequency_thz == pytest.approx(193.4, abs=1e-3)
    assert fiber.filter_nm * frequency_thz**2 / 299_792.458 == pytest.approx(0.050, rel=0.01)
    channels = (switch.max_frequency_mhz - switch.min_frequency_mhz) / switch.grid_mhz + 1
    assert channels == 96
    assert (switch.min_frequency_mhz - 193_100_000) % 12_500 == 0


def test_every_option_and_setting_has_a_default(pages: dict[str, str]) -> None:
    rows = [row.split(" | ") for row in ROW.findall(pages["docs/options.md"])]
    defaults = {row[0]: row[2] for row in rows}
    assert [name for name, default in defaults.items() if not default.strip()] == []
    assert defaults["`--eve-hides-db DB`"] == "0"
    assert defaults["`--time MODE`"] == "stepped where it can be"
    assert defaults["`--version`"] == "off"
    assert defaults["`IN_PORT`"] == "required"


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
