"""The page of all options has each verb, option, device setting and result field."""

import re
from dataclasses import fields

import pytest

from qmn.__main__ import VERBS, described
from qmn.results.run_result import RunResult
from views import reference
from views.completion import help_parsers
from wire.parameters.fiber import FiberOptics
from wire.parameters.option import unit_of
from wire.parameters.physics import Detectors, Device, Memory


@pytest.fixture(scope="module")
def page() -> str:
    return reference.page()


@pytest.mark.parametrize(
    "row",
    [
        "| `--loss-budget-db DB` | dB | 30.0 | 0 to 1000 | most loss of a light path (30) |",
        "| `--length-km KM` | km | 0.01 | 0 to 20000 | length of every fibre (0.01) |",
        "| `efficiency` |  | 1.0 | 0 to 1 | ideal | of storing and reading together |",
        "| `pauli_z` |  | 0.0 | 0 to 1 | ideal | probability of Z, for each photon |",
        "| `down\\|up` |  | required | down, up | what to do |",
    ],
)
def test_a_row_has_unit_default_range_and_source(page: str, row: str) -> None:
    assert f"\n{row}\n" in page


def test_every_verb_has_its_section(page: str) -> None:
    for verb in VERBS:
        assert f"\n## qmn {verb}\n" in page
    assert {"qmn set tap", "qmn lab sweep", "qmn run teleport"} <= sections(page)


def test_every_option_is_in_its_section_or_above(page: str) -> None:
    shared = page.partition("\n## qmn")[0]
    for parser in help_parsers(described(whole=True)):
        own = page.partition(f"\n## {parser.prog}\n")[2].partition("\n## ")[0]
        for action in parser._actions:
            if action.option_strings and action.dest != "help":
                assert re.search(rf"`{action.option_strings[-1]}[ `]", shared + own), action


def test_every_setting_and_result_is_there(page: str) -> None:
    assert {each.name for each in fields(Device)} == set(re.findall(r"`HOST\.(\w+)\.…`", page))
    for kind in (FiberOptics, Detectors, Memory):
        for each in fields(kind):
            if "range" in each.metadata:
                assert f"\n| `{each.name}` |" in page, each.name
    figures = page.partition("\n### RunResult\n")[2].partition("\n### ")[0]
    assert re.findall(r"^\| `(\w+)`", figures, re.MULTILINE) == [e.name for e in fields(RunResult)]


def test_a_unit_is_the_ending_of_a_name() -> None:
    names = ["length_km", "loss_db_per_km", "path_setup_ms", "classical_mw", "seed"]
    assert [unit_of(name) for name in names] == ["km", "dB/km", "ms", "mW", ""]


def sections(page: str) -> set[str]:
    return set(re.findall(r"^## (.*)$", page, re.MULTILINE))
