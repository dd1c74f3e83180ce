"""Sweeps of jobs that start networks of their own, before they do: axes, columns, words."""

import math
from pathlib import Path

import pytest

from evidence.curves.parameters import BadGrid, Values
from evidence.networks import run_sweep
from evidence.networks.job_sweep import grid_of, options_of


def test_columns_are_the_figures_of_the_job_beside_its_axes() -> None:
    grid = grid_of("load", {"rate_per_s": "5:20:4", "sessions": "100", "from": "alice"})
    names = [each.name for each in grid.experiment.measures]
    assert {"accepted", "carried_erlang", "setup_p99_s", "latency_s"} <= {*names}
    assert "sessions" not in names
    assert grid.axes["rate_per_s"] == [5, 10, 15, 20]
    assert len([*grid.experiment.groups([*grid.points()], 2)]) == 4  # each in a network of its own
    keys = [each.name for each in grid_of("keys", {"seconds": "10"}).experiment.measures]
    assert {"keys_per_s", "qber_highest"} <= {*keys}
    tunnel = [each.name for each in grid_of("vpn", {"rotate": "1,2"}).experiment.measures]
    assert {"file_intact", "keys_per_s"} <= {*tunnel}


def test_options_are_flags_of_the_command_line_and_settings_of_parts() -> None:
    axes: Values = {"with": "tls", "from": "alice", "node.detectors.dark_count_hz": 10.0}
    assert options_of("vpn", axes, 7) == {
        "seed": 7,
        "with": "tls",
        "from": "alice",
        "device": ["*.detectors.dark_count_hz=10.0"],
    }


@pytest.mark.parametrize(
    ("job", "axes", "text"),
    [
        ("keys", {"secnds": "1"}, "keys has no option secnds: did you mean seconds?"),
        ("keys", {"seconds": "0"}, "choose 0.1 to"),
        ("vpn", {"with": "magic"}, "choose wireguard"),
        ("load", {"seed": "1,2"}, "load has no option seed"),
        ("netqasm", {"rounds": "2"}, "say which application: --application FOLDER"),
        (
            "netqasm",
            {"application": "/nowhere"},
            "there is no /nowhere: name an application's folder",
        ),
    ],
)
def test_what_cannot_be_is_refused_before_any_start(
    job: str, axes: dict[str, object], text: str
) -> None:
    with pytest.raises(BadGrid, match=text):
        grid_of(job, axes)


def test_roles_of_applications_are_columns(tmp_path: Path) -> None:
    for name in ("app_alice.py", "app_bob.py", "other.py"):
        (tmp_path / name).touch()
    given = {"application": str(tmp_path), "rounds": "5", "input": "alice.x=1 bob.x=2,alice.x=3"}
    grid = grid_of("netqasm", given)
    assert grid.axes["input"] == ["alice.x=1 bob.x=2", "alice.x=3"]
    assert [each.name for each in grid.experiment.measures][:3] == ["alice", "bob", "latency_s"]


def test_of_a_role_the_one_number_of_every_round_is_measured() -> None:
    """Of 1, 0, 1, 0 the mean is 1/2, its standard error sqrt(1/3 / 4)."""
    outputs: list[dict[str, object]] = [
        {"alice": {"outcome": bit}, "bob": [0, bit], "charlie": "text"} for bit in (1, 0, 1, 0)
    ]
    found = run_sweep.of_rounds(outputs, "alice")
    assert found.value == 0.5
    assert found.error == pytest.approx(math.sqrt(1 / 12))
    for role in ("bob", "charlie", "ed"):
        assert math.isnan(run_sweep.of_rounds(outputs, role).value)
