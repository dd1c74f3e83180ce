"""The light paths that a run had, from its cross-connects and fibres."""

import json

import pytest
from recorded_run import NETWORK, events

from views.report.light_paths import light_paths, photons_by_port, without_outcome
from wire import typed_json
from wire.dispatcher_pb2 import Event
from wire.results.run_result import NetworkFacts


def test_a_path_leads_through_switches_that_were_connected_at_the_same_time() -> None:
    (path,) = light_paths(NETWORK, events())
    assert (path.begin, path.end) == ("alice-q0", "bob-q0")
    assert [(hop.name, round(hop.loss_db, 9)) for hop in path.hops] == [
        ("alice-q0 – q1:2", 1.0),  # noqa: RUF001
        ("q1 2→3", 0.7),
        ("q1:3 – q2:1", 2.0),  # noqa: RUF001
        ("q2 1→2", 0.3),  # differs from the switch's other paths
        ("bob-q0 – q2:2", 0.5),  # noqa: RUF001
    ]
    assert path.loss_db == pytest.approx(4.5)


def test_paths_lead_from_a_source_in_a_switch_into_a_memory_in_another() -> None:
    opened, other, *_, closed = events()
    opened.detail, other.detail = "62001 -> 3", "1 -> 61002"
    (path,) = light_paths(NETWORK, [opened, other, closed])
    assert (path.begin, path.end) == ("q1-source1", "q2-memory2")
    assert [hop.name for hop in path.hops] == ["q1:3 – q2:1", "q2 1→61002"]  # noqa: RUF001
    opened.detail, other.detail = "61001 -> 60001", "61002 -> 60002"  # a swap inside a switch
    assert light_paths(NETWORK, [opened, other]) == []


def test_half_a_path_is_none() -> None:
    assert light_paths(NETWORK, events()[:1]) == []
    closed_before = [events()[0], events()[-1], events()[1]]
    assert light_paths(NETWORK, closed_before) == []


def test_light_that_goes_in_circles_is_no_path() -> None:
    circle = [event for event in events() if event.kind == "open"]
    circle[1].detail = "1 -> 1"  # back where it came from
    assert light_paths(NETWORK, circle) == []


def test_photons_are_counted_where_they_arrive() -> None:
    arrived = next(event for event in events() if event.kind == "arrive")
    inside = [
        Event(kind="arrive", node=f"{q}-memory1", port="61001", photons=9) for q in ("q1", "q2")
    ]
    counts = {"bob-q0": (100, 40), "q1-memory1": (9, 0), "q2-memory1": (9, 0)}
    assert photons_by_port([arrived, *inside]) == counts


def test_a_pair_is_lost_if_either_half_is() -> None:
    measured = next(event for event in events() if event.kind == "bell-measure")
    measured.detail = "with 1/1: Phi+=20 Psi-=11"
    assert (without_outcome(measured), measured.lost) == (69, 40)


def test_a_network_survives_json() -> None:
    assert typed_json.read(NetworkFacts, json.loads(json.dumps(NETWORK.to_dict()))) == NETWORK
    assert NETWORK.host_at("s1-eth2") == "bob"
    assert NETWORK.host_at("bob-eth0") == "s1"
    assert NETWORK.host_at("c0") == ""
