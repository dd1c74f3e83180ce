"""Time is stepped by default, and paced where something in the network goes by the wall."""

import argparse
from pathlib import Path
from typing import Any

import pytest
from recorded_run import service_run

from qmn.machines.options import MachineOptions
from qmn.network.description import describe_network, describe_own
from qmn.network.options import NetworkOptions
from qmn.network.time_scale import Pace, time_mode
from qmn.options import BadInput
from qmn.requests.run_options import RunOptions
from qmn.results.pace_row import note_pace, rows
from qmn.verbs.cli import CliOptions, start_and_obey
from topologies.links.copper_link import CopperLink
from topologies.sdc import SdcTopo


def pace(run: RunOptions | None = None, **options: Any) -> Pace:
    described = describe_network(NetworkOptions(topology="sdc", **options))
    return described.paced_for(*(run or RunOptions()).against_steps).pace


def test_time_is_stepped_unless_somebody_says_how_it_is_paced() -> None:
    assert pace().stepped
    assert pace(time="stepped", host_delay="5ms").stepped
    assert not pace(time="paced").stepped
    assert (pace(time="paced=40").stepped, pace(time="paced=40").scale) == (False, 40.0)
    assert not pace(time="paced", control_loss=0.1).reason  # it was asked for


def test_a_row_says_how_time_passed_and_why() -> None:
    for chosen, text in (
        (Pace(), "stepped: it stands while software runs"),
        (Pace(False), "paced: by the wall clock"),
        (Pace(False, 5.0), "paced: a second of the network takes 5 s here"),
        (Pace(False, reason="people type"), "paced: by the wall clock, as people type"),
    ):
        facts = service_run()
        note_pace(facts, chosen)
        assert rows(facts)["time"] == text


@pytest.mark.parametrize(
    "text", ["fast", "stepped=2", "paced=0.5", "paced=", "paced=nan", "paced=2e9", "paced=auto", ""]
)
def test_a_mode_of_time_that_there_is_not_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="choose stepped, paced, or paced=K"):
        time_mode(text)


PACED = [
    ({"control_loss": 0.1}, RunOptions(), "--control-loss"),
    ({"sabot": "/tmp/socket"}, RunOptions(), "--sabot"),
    ({"apps": ("own",)}, RunOptions(), "--app"),
    ({}, RunOptions(machines=2), "--machines"),
    ({}, RunOptions(classical_mbps=5.0), "--classical-mbps"),
]


@pytest.mark.parametrize(("options", "run", "reason"), PACED, ids=[each[2] for each in PACED])
def test_what_goes_by_the_wall_paces_the_network_with_the_reason(
    options: dict[str, object], run: RunOptions, reason: str
) -> None:
    chosen = pace(run, **options)
    assert (chosen.stepped, chosen.scale) == (False, 1.0)
    assert reason in chosen.reason
    with pytest.raises(BadInput, match=f"--time stepped: .*{reason}.*; leave it out"):
        pace(run, time="stepped", **options)
    with pytest.raises(BadInput, match=f"--host-delay is exact in stepped time alone: .*{reason}"):
        pace(run, host_delay="5ms", **options)


def test_a_policy_is_stepped_if_it_watches_light_too(tmp_path: Path) -> None:
    policy = tmp_path / "policy.toml"
    for watch in ("", '[[watch]]\nbetween = ["alice", "bob"]\n'):
        policy.write_text(f'default = "allow"\n{watch}')
        assert pace(policy=str(policy)).stepped


class Own(SdcTopo):
    """With parts that go by the wall: copper that loses packets, an instrument."""

    def build(self, part: str = "", **parameters: Any) -> None:
        super().build(**parameters)
        if part == "loss":
            self.addLink(self.addHost("dave"), "s1", cls=CopperLink, loss=0.1)
        if part == "hardware":
            self.nodeInfo("q1")["hardware"] = "scpi://192.0.2.7:5025"


@pytest.mark.parametrize(
    ("part", "reason"),
    [
        ("loss", "TCP repeats by the wall what copper dave to s1 loses"),
        ("hardware", "the instrument of q1 runs in real time"),
    ],
)
def test_parts_of_a_topology_that_go_by_the_wall_pace_it(part: str, reason: str) -> None:
    described = describe_own(lambda: Own(part=part), NetworkOptions())
    assert (described.pace.stepped, described.pace.reason) == (False, reason)


def test_other_machines_go_by_the_wall_for_people_at_a_prompt_too() -> None:
    options = NetworkOptions(topology="sdc", time="stepped")
    with pytest.raises(BadInput, match="other machines have clocks of their own"):
        start_and_obey(options, [], MachineOptions(machines=2), CliOptions())
