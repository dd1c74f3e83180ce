"""A fibre's parameters: declared once, checked once, the same wherever they are given."""

import re
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pytest

from wire.parameters.fiber import KINDS, Fiber, FiberEnd, FiberOptics, optics
from wire.parameters.physics import BadParameter
from wire.typed_json import read

PAGE = Path(__file__).resolve().parents[3] / "docs" / "fibers.md"


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"length_km": -1}, "length_km -1: choose 0 to 2000"),
        ({"length_km": 20001.0}, "length_km 20001.0: choose 0 to 20000"),
        ({"length_km": float("nan")}, "length_km nan: choose"),
        ({"length_km": "far"}, "length_km 'far': choose 0 to 2000"),
        ({"loss_db_per_km": -0.2}, "loss_db_per_km -0.2: choose 0 to 1000"),
        ({"depolarizing": True}, "depolarizing True: choose 0 to 1"),
        ({"polarization_drift_time_s": 0}, "polarization_drift_time_s 0: choose 1e-09 to 1e"),
        ({"kind": "glass"}, "kind 'glass': choose one of ideal, smf, pm, custom"),
        ({"lenght_km": 1, "loss": 2}, "it has no lenght_km: did you mean length_km"),
        (
            {"noise": "a.py:B", "noise_parameters": [1]},
            "noise_parameters [1]; give FILE.py:CLASS and a dictionary",
        ),
    ],
)
def test_what_no_fibre_is_like_is_refused_with_name_value_and_range(
    given: dict[str, Any], text: str
) -> None:
    with pytest.raises(BadParameter, match=re.escape(text)):
        optics("it", **given)


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_brings_its_values_along_and_what_is_given_goes_before_them(kind: str) -> None:
    assert optics("it", kind=kind) == FiberOptics(kind=kind, **KINDS[kind])  # type: ignore[arg-type]
    assert optics("it", kind=kind, loss_db_per_km=7).loss_db_per_km == 7


def test_a_fibre_goes_through_json_unchanged() -> None:
    described = optics("it", kind="pm", noise="/a.py:B", noise_parameters={"x": [1]})
    fiber = Fiber.joining(FiberEnd("alice", "alice-q0"), FiberEnd("q1", "2"), described)
    assert read(Fiber, asdict(fiber)) == fiber
    assert (fiber.a.node, fiber.loss_db_per_km) == ("alice", 0.5)


def test_the_readme_has_every_parameter_with_its_range_and_default() -> None:
    table = [line for line in PAGE.read_text().splitlines() if line.startswith("| `")]
    for each in fields(FiberOptics):
        (row,) = [line for line in table if f"`{each.name}`" in line.split("|")[1]]
        names, ranges, defaults = (cell.strip() for cell in row.split("|")[1:4])
        if "range" not in each.metadata:
            continue
        own = re.findall(r"`(\w+)`", names).index(each.name)
        if each.default is None:
            assert defaults.split("; ")[own if "; " in defaults else 0] == "none", each.name
            defaults = "nan"
        given = [cell.split("; ") for cell in (ranges, defaults)]
        found, default = (cells[own if len(cells) > 1 else 0] for cells in given)
        least, most = (float(text.replace(",", "")) for text in found.split(" to "))
        assert (least, most) == each.metadata["range"], each.name
        assert each.default in (None, float(default.replace(",", ""))), each.name
