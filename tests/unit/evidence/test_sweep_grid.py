"""Grids are checked before anything runs, and say what would do instead."""

from pathlib import Path

import pytest

from evidence.curves import grid as grids
from evidence.curves.catalogue import EXPERIMENTS
from evidence.curves.grid import Grid, build
from evidence.curves.parameters import BadGrid, Parameter
from evidence.networks.catalogue import EMULATED

SDC = EXPERIMENTS["sdc"]


@pytest.mark.parametrize(
    ("given", "values"),
    [
        ("0.1", [0.1]),
        ("0.1,0.3", [0.1, 0.3]),
        ("0.1,0.1", [0.1]),
        ("0:1:3", [0.0, 0.5, 1.0]),
        ("0:0.3:4", [0.0, 0.1, 0.2, 0.3]),
        ("0.001:0.1:3:log", [0.001, 0.01, 0.1]),
        (0.5, [0.5]),
        ([0.1, 0.2], [0.1, 0.2]),
        ({"from": 0, "to": 1, "points": 2}, [0.0, 1.0]),
        ({"from": 0.01, "to": 1, "points": 3, "log": True}, [0.01, 0.1, 1.0]),
    ],
)
def test_values_are_typed_one_by_one_or_spaced(given: object, values: list[float]) -> None:
    assert SDC.parameter("depolarizing").axis(given) == values


def test_whole_numbers_stay_whole() -> None:
    values = SDC.parameter("pairs").axis("1000:4000:3")
    assert values == [1000, 2500, 4000]
    assert all(isinstance(value, int) for value in values)


@pytest.mark.parametrize(
    ("name", "given", "text"),
    [
        ("depolarising", "1", "not a parameter of sdc: did you mean depolarizing?"),
        ("colour", "1", "colour is not a parameter of sdc: choose one of preset, kind, length_km"),
        ("depolarizing", "1.5", "depolarizing '1.5': choose 0 to 1"),
        ("depolarizing", "-0.1:1:3", "depolarizing '-0.1': choose 0 to 1"),
        ("depolarizing", "nan", "depolarizing 'nan': choose 0 to 1"),
        ("depolarizing", "many", "depolarizing 'many': choose 0 to 1"),
        ("depolarizing", "0:1", "depolarizing 0:1: write from:to:count"),
        ("depolarizing", "0:1:1", "count '1': choose 2 to 10000"),
        ("depolarizing", "0:1:3:log", "a logarithmic scale has no 0"),
        ("depolarizing", "0:1:3:lin", "write from:to:count"),
        ("depolarizing", "", "depolarizing '': choose 0 to 1"),
        ("depolarizing", [], "depolarizing has no value"),
        ("depolarizing", True, "depolarizing True: choose 0 to 1"),
        ("depolarizing", [[0.1]], "depolarizing [0.1]: choose 0 to 1"),
        ("depolarizing", {"from": 0, "to": 1}, "say from, to and points"),
        ("pairs", "1000.5", "pairs '1000.5': choose 1000 to 1e+08 (a whole number)"),
        ("pairs", "10", "pairs '10': choose 1000"),
        ("fec", "turbo", "fec 'turbo': choose none, repetition, hamming, golay"),
        ("length_km", "-1", "length_km '-1': choose 0 to 20000 km"),
        ("detectors_efficiency", "1.1", "detectors_efficiency '1.1': choose 0 to 1"),
        ("kind", "glass", "kind 'glass': choose ideal, smf, pm"),
    ],
)
def test_a_bad_value_is_named_with_its_range(name: str, given: object, text: str) -> None:
    with pytest.raises(BadGrid) as caught:
        build(SDC, {name: given})
    assert text in str(caught.value)


def test_too_many_points_are_refused() -> None:
    with pytest.raises(BadGrid, match=r"10,201 points \(101 depolarizing x 101 length_km\)"):
        build(SDC, {"depolarizing": "0:1:101", "length_km": "0:1:101"})
    with pytest.raises(BadGrid, match="110,000,000,000 pairs in all points"):
        build(SDC, {"depolarizing": "0:1:1100", "pairs": 100_000_000})


def test_a_grid_has_every_combination() -> None:
    grid = build(SDC, {"depolarizing": [0.1, 0.2], "fec": "none,golay"})
    points = [(values["depolarizing"], values["fec"]) for values in grid.points()]
    assert points == [(0.1, "none"), (0.1, "golay"), (0.2, "none"), (0.2, "golay")]
    assert grid.size == len(points)
    assert next(iter(grid.points()))["pairs"] == 200_000


def test_a_preset_and_a_kind_of_fibre_bring_values_along_and_what_is_given_stays() -> None:
    grid = build(SDC, {"preset": "metro", "length_km": [0.01, 1]})
    for values, length_km in zip(grid.points(), (0.01, 1), strict=True):
        assert values["length_km"] == length_km
        assert values["connectors_db"] == 0.5
        assert values["loss_db_per_km"] == 0.2
        assert values["source_fidelity"] == 0.95
    (values,) = build(SDC, {"kind": "pm", "polarization_drift_rad_per_sqrt_km": 0.0}).points()
    assert values["loss_db_per_km"] == 0.5
    assert values["polarization_drift_rad_per_sqrt_km"] == 0.0


@pytest.mark.parametrize(
    ("text", "remedy"),
    [("0-0.2", ": write 0:0.2:11"), ("2%", ": write 0.02"), ("-1", ""), ("1e-3-1", "")],
)
def test_what_people_write_is_answered_by_what_to_write(text: str, remedy: str) -> None:
    with pytest.raises(BadGrid) as caught:
        build(SDC, {"depolarizing": text})
    assert str(caught.value) == f"depolarizing {text!r}: choose 0 to 1{remedy}"


def test_a_file_says_what_to_sweep(tmp_path: Path) -> None:
    file = tmp_path / "sweep.toml"
    file.write_text(
        'sweep = "sdc"\nseed = 3\n[grid]\nfec = ["none"]\n'
        "depolarizing = { from = 0, to = 0.2, points = 3 }\n"
    )
    content = grids.read(file)
    grid = build(EXPERIMENTS[content["sweep"]], content["grid"])
    assert isinstance(grid, Grid)
    assert grid.axes == {"fec": ["none"], "depolarizing": [0.0, 0.1, 0.2]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sweep = ", "is not a TOML file"),
        ("seed = 1", "does not say what to sweep"),
        ("sweep = 3", "does not say what to sweep"),
        ('sweep = "sdc"\ngrids = 1', "has no grids: did you mean grid"),
        ('sweep = "sdc"\ngrid = 1', "grid is not a table"),
    ],
)
def test_a_bad_file_is_named(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "sweep.toml"
    file.write_text(text)
    with pytest.raises(BadGrid, match=message) as caught:
        grids.read(file)
    assert str(file) in str(caught.value)


def test_names_are_said_with_their_unit() -> None:
    length = Parameter("loss_db_per_km", 0.2, 0.0, 1.0, "dB/km")
    assert length.formatted(0.2) == "loss 0.2 dB/km"
    assert length.label == "loss (dB/km)"


TOPOLOGY, SENDER = Parameter("topology", "", text="any"), Parameter("from", "", text="the asker")


def test_text_is_taken_as_it_is_also_with_colons_and_several_with_commas() -> None:
    assert TOPOLOGY.axis("my_net.py:MyNet") == ["my_net.py:MyNet"]
    assert SENDER.axis("h1,h2") == ["h1", "h2"]
    with pytest.raises(BadGrid, match="from 7: the asker"):
        SENDER.value(7)


def parameters() -> list[Parameter]:
    """Return the parameters of all experiments."""
    experiments = (*EXPERIMENTS.values(), *EMULATED.values())
    return [parameter for each in experiments for parameter in each.parameters]


def test_every_choice_can_be_typed_beside_others() -> None:
    """Commas part values, and a shell parts words at spaces."""
    for parameter in parameters():
        chosen = list(parameter.choices)
        assert not chosen or parameter.axis(",".join(chosen)) == chosen
        assert not any(" " in choice for choice in chosen)


def test_units_are_those_of_the_field() -> None:
    """PMD is given in ps/sqrt km, dispersion in ps/(nm km): ITU-T G.650.2 and G.650.1."""
    units = {parameter.name: parameter.unit for parameter in parameters()}
    assert units["pmd_ps_per_sqrt_km"] == "ps/sqrt km"
    assert units["dispersion_ps_per_nm_km"] == "ps/(nm km)"
    assert units["length_km"] == "km"
    for name, unit in units.items():
        assert "_per_" not in name or "/" in unit, name
