"""`--time-scale`: a number, or as slowly as the shortest time of a network needs."""

import argparse
from dataclasses import replace
from functools import partial

import pytest
from mininet.topo import Topo
from recorded_run import service_run

from qmn.network.description import describe_network
from qmn.network.options import NetworkOptions
from qmn.network.time_scale import SHARE, SOFTWARE_S, Pace, pace, scale, scale_of
from qmn.options import add_options, read
from qmn.results.run_result import RunResult
from qmn.results.software_share import note_software, rows
from topologies.description.content import content_of
from topologies.description.description import Description, describe
from topologies.sdc import SdcTopo
from wire.dispatcher_pb2 import SoftwareTime
from wire.parameters.physics import Device, Memory
from wire.results.run_result import ShortestTime

LIGHT_M_PER_S = 2.04e8


@pytest.fixture(autouse=True)
def idle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.getloadavg", lambda: (0.1, 0.1, 0.1))


@pytest.mark.parametrize("text", ["0", "0.5", "fast", "nan", "2e9", ""])
def test_what_is_no_scale_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        scale(text)


@pytest.mark.parametrize("text", ["fast", "stepped=2", "paced=0.5", "paced=", ""])
def test_what_is_no_mode_of_time_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        pace(text)


def test_a_pace_says_the_scale() -> None:
    assert NetworkOptions(time=pace("paced=40")) == NetworkOptions(time_scale=40.0)
    assert NetworkOptions(time=pace("paced=auto")) == NetworkOptions(time_scale="auto")
    assert replace(NetworkOptions(time="paced=40"), seed=2).time_scale == 40.0
    assert (pace("paced"), pace("stepped")) == ("paced", "stepped")


def test_a_scale_that_is_named_is_taken_as_it_is() -> None:
    assert scale("40") == 40.0
    assert scale_of(40.0, described(SdcTopo())).scale == 40.0


def test_auto_goes_by_the_shortest_time_of_the_network() -> None:
    long = partial(SdcTopo, length_km=100.0)
    delay_s = 100e3 / LIGHT_M_PER_S
    chosen = scale_of("auto", described(long()))
    assert chosen.scale == pytest.approx(SOFTWARE_S / (SHARE * delay_s), rel=0.005)
    assert "the fibre from alice to q1" in chosen.reason
    decays = partial(long, devices={"bob": Device(memory=Memory(t2_s=1e-5))})
    chosen = scale_of("auto", described(decays()))
    assert chosen.scale == pytest.approx(SOFTWARE_S / (SHARE * 1e-5), rel=0.005)
    assert "T2 of bob" in chosen.reason
    assert "cannot be reached" not in chosen.reason


def described(topo: Topo) -> Description:
    return describe(content_of(topo))


def chosen_for(*words: str) -> Pace:
    parser = argparse.ArgumentParser()
    add_options(parser, NetworkOptions)
    words = ("--time-scale", "auto", *words)
    named = replace(read(NetworkOptions, parser.parse_args(words)), topology="sdc")
    return describe_network(named).pace


@pytest.mark.parametrize(
    ("words", "way_km"),
    [
        # alice and bob have 100 km of copper each to s1, which is where q1 is.
        (["--device", "bob.memory.t2_s=1e-5"], 200),
        (["--device", "bob.memory.t2_s=1e-5", "--copper-km", "300"], 600),
        (["--device", "bob.memory.t2_s=1e-5", "--control-km", "5000"], 5000),
    ],
)
def test_auto_lets_a_packet_and_its_answer_take_half_a_minute_at_most(
    words: list[str], way_km: float
) -> None:
    chosen = chosen_for("--length-km", "100", *words)
    round_trip_s = 2 * way_km * 1e3 / LIGHT_M_PER_S
    assert chosen.scale == pytest.approx(30 / round_trip_s, rel=0.005)
    percent = 100 * 0.02 / (30 / round_trip_s) / 1e-5  # 20 ms of software
    assert f" {percent:.3g}% of T2 of bob" in chosen.reason
    assert "1% cannot be reached" in chosen.reason


def test_no_load_of_the_machine_leads_auto_beyond_what_tcp_lives_through(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("os.getloadavg", lambda: (94.0, 1.0, 1.0))
    chosen = chosen_for("--length-km", "10")
    round_trip_s = 2 * 20e3 / LIGHT_M_PER_S
    assert chosen.scale * round_trip_s == pytest.approx(30, rel=0.005)
    assert "1% cannot be reached" in chosen.reason


def test_auto_is_slower_on_a_machine_that_is_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    idle = scale_of("auto", described(SdcTopo())).scale
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("os.getloadavg", lambda: (6.0, 1.0, 1.0))
    assert scale_of("auto", described(SdcTopo())).scale == pytest.approx(3 * idle, rel=0.01)


def test_a_network_without_a_time_of_its_own_runs_in_real_time() -> None:
    assert scale_of("auto", described(SdcTopo(length_km=0.0))).scale == 1.0


NAMED = Pace(1.0)


def facts_of(share: float, software_s: float, t2_s: float, scale: Pace = NAMED) -> RunResult:
    told = SoftwareTime(
        largest_wait_share=share, largest_decaying_share=share, longest_ns=round(software_s * 1e9)
    )
    facts = service_run()
    facts.time_scale = scale.scale
    note_software(facts, told, [Device(), Device(memory=Memory(t2_s=t2_s))], scale)
    return facts


@pytest.mark.parametrize(("software_s", "kept"), [(0.9e-3, True), (1.1e-3, False)])
def test_what_auto_means_is_held_against_what_was_measured(software_s: float, kept: bool) -> None:
    auto = Pace(40.0, "because", ("T2 of bob", 0.1))
    facts = facts_of(0.1, software_s, 0.1, auto)
    assert facts.software_of_shortest == pytest.approx(software_s / 0.1)
    assert facts.shortest_time == ShortestTime("T2 of bob", 0.1)
    assert facts.time_scale_kept is kept
    assert ("Warning" in rows(facts)) is not kept
    if not kept:  # 1.1 % instead of 1 % wants 1.1 times the scale
        assert "1.10% of T2 of bob" in rows(facts)["Warning"]
        assert "a scale of 44 was needed" in rows(facts)["Warning"]


def test_a_scale_that_is_named_promises_nothing_but_is_told_its_share() -> None:
    facts = facts_of(0.1, 0.05, 0.1, Pace(40.0, shortest=("T2 of bob", 0.1)))
    assert facts.software_of_shortest == pytest.approx(0.5)
    assert facts.time_scale_kept is None


def test_a_result_is_marked_if_most_of_a_wait_that_matters_was_software() -> None:
    marked = facts_of(0.9, 0.02, t2_s=0.1)
    assert marked.dominated_by_software is True
    assert "Warning" in rows(marked)
    assert facts_of(0.9, 0.02, t2_s=10.0).dominated_by_software is False  # .2 % of T2
    assert facts_of(0.4, 0.02, t2_s=0.1).dominated_by_software is False
    assert "Warning" not in rows(facts_of(0.4, 0.02, t2_s=0.1))


def test_a_wait_that_harms_nothing_and_a_scale_of_one_are_no_news() -> None:
    lines = rows(facts_of(0.9, 0.02, t2_s=10.0))
    assert lines["software"] == (
        "programs account for up to 90.0% of a wait in memory, 0.02 s; "
        "no effect, as these memories do not decay in that time"
    )
    assert "no effect" not in rows(facts_of(0.4, 0.02, t2_s=10.0))["software"]
    assert lines["time"] == "paced: by the wall clock"
    slower = rows(facts_of(0.9, 0.02, t2_s=10.0, scale=Pace(5.0)))
    assert slower["time"] == "paced: a second of the network takes 5 s here"


def test_where_nothing_waited_no_share_is_made_up() -> None:
    facts = service_run()
    note_software(facts, SoftwareTime(), [Device()], Pace(40.0, "because", ("T2 of bob", 0.1)))
    assert facts.software_share is None
    assert facts.software_of_shortest is facts.time_scale_kept is None
    assert "software" not in rows(facts)
