"""The views of console and REST on sessions, paths and fibres."""

import json

from metadata_scene import BOB, FRAMED, Q1, S1, arbiter, frame

from controller_apps.console.views import fibers_view, paths_view, sessions_view
from controller_apps.light.optics import SwitchPort


def test_a_session_is_shown_with_its_names_and_light_paths() -> None:
    state = arbiter()
    state.segment_arrived(S1, 1, frame(FRAMED.encode(), destination=BOB), 10.0)
    (session,) = sessions_view(state.sessions, state.network, 12.5)
    assert session == {
        "session": f"{FRAMED.session:016x}",
        "service": "sdc",
        "handshake": "framed",
        "from": "alice",
        "to": "bob",
        "source": "charlie",
        "rate_hz": 1_000_000,
        "frame_bytes": 100,
        "fec": "none",
        "interleave": "off",
        "wavelength_pm": 1_550_120,
        "open": False,  # no switch has answered
        "silent_s": 2.5,
        "waits_for_light": False,
        "stranded": False,
        "hops": 3,
    }
    paths = paths_view(state.sessions, state.network)
    assert [(path["begin"], path["end"], path["hops"]) for path in paths] == [
        ("charlie-q0", "alice-q0", [{"dpid": f"{Q1:016x}", "in_port": 4, "out_port": 1}]),
        ("alice-q0", "bob-q1", [{"dpid": f"{Q1:016x}", "in_port": 1, "out_port": 3}]),
        ("charlie-q1", "bob-q0", [{"dpid": f"{Q1:016x}", "in_port": 5, "out_port": 2}]),
    ]
    assert {path["frequency_mhz"] for path in paths} == {193_400_000}
    json.dumps([session, paths])


def test_fibers_are_shown_with_both_kinds_of_ends_and_cuts() -> None:
    network = arbiter().network
    network.add_link(SwitchPort(Q1, 9), SwitchPort(3, 1))
    network.set_fiber(SwitchPort(Q1, 2), False)
    fibers = {(fiber["dpid"], fiber["port"]): fiber for fiber in fibers_view(network)}
    here, there = f"{Q1:016x}", f"{3:016x}"
    assert (fibers[here, 9]["to"], fibers[there, 1]["to"]) == (f"{there}:1", f"{here}:9")
    assert (fibers[here, 2]["to"], fibers[here, 2]["up"]) == ("bob-q0", False)
    assert len(fibers) == 7


def test_a_fibre_between_switches_is_whole_again_when_both_ends_were_heard() -> None:
    network, here, there = arbiter().network, SwitchPort(Q1, 9), SwitchPort(3, 1)

    def whole() -> list[bool]:
        fibers = {(int(each["dpid"], 16), each["port"]): each for each in fibers_view(network)}
        assert (fibers[here]["to"], fibers[there]["to"]) == (f"{3:016x}:1", f"{Q1:016x}:9")
        return [fibers[end]["up"] for end in (here, there)]

    network.add_link(here, there)
    assert whole() == [True, True]
    network.set_fiber(here, False)
    assert whole() == [False, False]
    network.set_fiber(here, True)
    assert whole() == [False, False]  # no light is sent there yet
    network.add_link(here, there)
    assert whole() == [True, True]
