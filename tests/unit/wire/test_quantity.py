"""Numbers with units, as options take them."""

from typing import Any

import pytest

from applications.keys.request import EveSchedule
from applications.vpn.request import VpnRequest
from qmn.options import from_keywords
from wire.parameters.option import unit_of
from wire.parameters.quantity import quantity


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("t2_s", "0.1", 0.1),
        ("t2_s", "100ms", 0.1),
        ("t2_s", "5us", 5e-6),  # and not 4.9999999999999996e-06
        ("t2_s", "5 µs", 5e-6),
        ("t2_s", "2min", 120.0),
        ("dead_time_ns", "0.5us", 500.0),
        ("jitter_ps", "1e-3ns", 1.0),
        ("length_km", "500m", 0.5),
        ("length_km", "5km", 5.0),
        ("wavelength_nm", "1.55um", 1550.0),
        ("loss_db", "2dB", 2.0),
        ("loss_db_per_km", "0.2dB/km", 0.2),
        ("linewidth_hz", "3kHz", 3000.0),
        ("power_mw", "5uW", 0.005),
        ("copper_mbps", "1Gbit/s", 1000.0),
        ("loss_db", "-3", -3.0),
    ],
)
def test_a_number_is_in_the_unit_of_its_option(name: str, text: str, value: float) -> None:
    assert quantity(unit_of(name), text, float) == value


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [("rate_hz", "1.5kHz", 1500), ("frame_bytes", "1KiB", 1024), ("count", "1e6", 1_000_000)],
)
def test_a_whole_number_stays_one(name: str, text: str, value: int) -> None:
    number = quantity(unit_of(name), text, int)
    assert (number, type(number)) == (value, int)


@pytest.mark.parametrize(
    ("name", "text", "kind", "why"),
    [
        ("t2_s", "5km", float, "'5km': choose a number of s, as 5 or 5s"),
        ("length_km", "5kg", float, "choose a number of km"),
        ("rate_per_s", "5ms", float, "choose a number of 1/s"),
        ("loss_db_per_km", "2dB", float, "dB/km"),
        ("loss_db", "2 DB", float, "choose a number of dB"),
        ("depolarizing", "5s", float, "'5s': choose a number"),
        ("depolarizing", "2%", float, "'2%': choose a number: write 0.02"),
        ("rate_hz", "1.5Hz", int, "choose a whole number of Hz"),
        ("t2_s", "", float, "'': choose"),
        ("t2_s", "1e999999999s", float, "choose a number"),
        ("t2_s", "1__0ms", float, "choose a number"),
    ],
)
def test_anything_else_is_refused(name: str, text: str, kind: type[int], why: str) -> None:
    with pytest.raises(ValueError, match=why.replace("(", r"\(")):
        quantity(unit_of(name), text, kind)


@pytest.mark.parametrize(
    ("request_class", "name", "value"),
    [(EveSchedule, "at", 90.0), (VpnRequest, "rotate", 90.0)],
)
def test_an_option_whose_name_has_no_unit_has_that_of_its_metavar(
    request_class: type[Any], name: str, value: float
) -> None:
    found = from_keywords(request_class, {name: "1.5min"})
    assert getattr(found, name) == value
