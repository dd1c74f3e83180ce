"""Channels of fibres by wavelength: which one a session gets; by the arbiter alone.

Hosts a1 … a4 are at switch 2, b1 … b4 at switch 3, between them a fibre of three channels.
"""

from dataclasses import replace

import pytest
from metadata_scene import frame, payload_of
from scapy.layers.inet import IP

from controller_apps.light.optics import SwitchPort
from controller_apps.light.paths import Direction, HostPort, Network
from controller_apps.sessions.actions import Action, Forward, Note, OpenPaths
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.snapshot import decode_session, encode_session
from wire.metadata.decoding import decode
from wire.metadata.setup import SETUP_LENGTH, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service, Verdict
from wire.optical import ANY_WAVELENGTH, TX_PWR, USE_FREQ, PortOptics

S1, Q1, Q2, Q3 = 1, 2, 3, 4
TRUNK = 10  # port of the first channel of a fibre; of the further ones 1010 and 2010
# The grid of ITU-T G.694.1 with 100 GHz, as its table has it: 193.4, 193.5 and 193.6 THz.
MHZ = 193_400_000, 193_500_000, 193_600_000
PM = 1_550_116, 1_549_315, 1_548_515


def host(side: str, number: int) -> str:
    return f"10.0.{'abc'.index(side)}.{number}"


def channels(network: Network, at: SwitchPort, count: int = 3) -> list[SwitchPort]:
    """Let the ports of a fibre's channels describe themselves; return them."""
    ports = [SwitchPort(at.dpid, at.port + 1000 * channel) for channel in range(count)]
    for port, mhz in zip(ports, MHZ, strict=False):
        own = PortOptics(TX_PWR | USE_FREQ, mhz, mhz, 100_000, mhz, mhz, 100_000, -200, 0)
        network.optics.described(port, own)
    return ports


def fiber(network: Network, one: SwitchPort, other: SwitchPort, count: int = 3) -> None:
    """Lay a fibre of channels between two switches."""
    for pair in zip(channels(network, one, count), channels(network, other, count), strict=True):
        network.add_link(*pair)


def trunk(queues: bool = False, switches: int = 2, count: int = 3) -> Arbiter:
    network = Network({Q1, Q2, Q3})
    for dpid, side in ((Q1, "a"), (Q2, "b"), (Q3, "c"))[:switches]:
        for number in range(1, 5):
            port = HostPort(f"{side}{number}", host(side, number), f"{side}{number}-q0")
            network.attach(SwitchPort(dpid, number), port)
    for left in (Q1, Q2)[: switches - 1]:
        fiber(network, SwitchPort(left, TRUNK), SwitchPort(left + 1, TRUNK + left), count)
    return Arbiter(network, 5.0, 30.0, queues=queues)


def bb84(session: int, wavelength_pm: int = ANY_WAVELENGTH) -> Setup:
    source = host("a", session)
    asked = session, Service["BB84"], Handshake.FRAMED, source, 1, 1, 1
    return Setup(*asked, wavelength_pm=wavelength_pm)


def ask(state: Arbiter, setup: Setup, ends: tuple[str, str], now: float = 0.0) -> list[Action]:
    """Ask, and let switches do as the controller says."""
    ports = {"sport": 40_000 + setup.session, "source": ends[0], "destination": ends[1]}
    sent = frame(replace(setup, source=ends[0]).encode(), **ports)  # type: ignore[arg-type]
    return obeyed(state, state.segment_arrived(S1, 1, sent, now), now)


def end(state: Arbiter, session: int, ends: tuple[str, str], now: float = 1.0) -> list[Action]:
    ports = {"sport": 40_000 + session, "source": ends[0], "destination": ends[1]}
    sent = frame(flags="FA", seq=100 + SETUP_LENGTH, **ports)  # type: ignore[arg-type]
    return obeyed(state, state.segment_arrived(S1, 1, sent, now), now)


def obeyed(state: Arbiter, actions: list[Action], now: float) -> list[Action]:
    for action in list(actions):
        if isinstance(action, OpenPaths):
            actions += state.barrier_passed(action.dpid, action.transaction, now)
    return actions


def answer(actions: list[Action]) -> Setup:
    (sent,) = [action for action in actions if isinstance(action, Forward)]
    setup = decode(payload_of(sent.frame))
    assert isinstance(setup, Setup)
    assert IP(sent.frame[14:]).dst
    return setup


def pair(number: int) -> tuple[str, str]:
    return host("a", number), host("b", number)


def test_each_session_gets_the_first_channel_that_is_free_and_is_told_which() -> None:
    state = trunk()
    for number, wavelength_pm in enumerate(PM, 1):
        actions = ask(state, bb84(number), pair(number))
        assert (answer(actions).verdict, answer(actions).wavelength_pm) == (
            Verdict.GRANTED,
            wavelength_pm,
        )
        bundles = [action for action in actions if isinstance(action, OpenPaths)]
        out, into = TRUNK + 1000 * (number - 1), TRUNK + Q1 + 1000 * (number - 1)
        assert [bundle.hops for bundle in bundles] == [
            ((Q1, number, out),),
            ((Q2, into, number),),
        ]
        assert all(out not in bundle.tuned for bundle in bundles)  # its multiplexer fixes it
        assert state.sessions.by_number[number].frequency_mhz == MHZ[number - 1]


def test_who_finds_no_channel_is_refused_as_busy() -> None:
    state = trunk()
    for number in (1, 2, 3):
        ask(state, bb84(number), pair(number))
    refused = answer(ask(state, bb84(4), pair(4)))
    assert (refused.verdict, refused.reason) == (Verdict.REFUSED, Reason.BUSY)


@pytest.mark.parametrize("freed", [1, 2, 3])
def test_who_waits_gets_whichever_channel_becomes_free(freed: int) -> None:
    state = trunk(queues=True)
    for number in (1, 2, 3):
        ask(state, bb84(number), pair(number))
    waiting = ask(state, bb84(4), pair(4))
    assert [note.event for note in waiting if isinstance(note, Note)] == ["queued"]
    granted = end(state, freed, pair(freed))
    (forwarded,) = [
        decode(payload_of(action.frame))
        for action in granted
        if isinstance(action, Forward) and payload_of(action.frame)
    ]
    assert isinstance(forwarded, Setup)
    assert (forwarded.session, forwarded.wavelength_pm) == (4, PM[freed - 1])


def test_a_wavelength_that_is_named_is_kept_to() -> None:
    state = trunk()
    assert answer(ask(state, bb84(1, PM[1]), pair(1))).wavelength_pm == PM[1]
    assert answer(ask(state, bb84(2, PM[1]), pair(2))).reason == Reason.BUSY
    assert answer(ask(state, bb84(3, 1_540_000), pair(3))).reason == Reason.NO_WAVELENGTH


def test_light_keeps_one_channel_from_end_to_end() -> None:
    """Each fibre has a free channel, but no channel is free on both."""
    state = trunk(switches=3, count=2)
    ask(state, bb84(1), (host("a", 1), host("b", 1)))  # channel 1 of the first fibre
    ask(state, bb84(2, PM[1]), (host("b", 2), host("c", 2)))  # channel 2 of the second one
    refused = answer(ask(state, bb84(3), (host("a", 3), host("c", 3))))
    assert refused.reason == Reason.BUSY
    end(state, 1, (host("a", 1), host("b", 1)))
    granted = answer(ask(state, bb84(4), (host("a", 4), host("c", 4))))
    assert (granted.verdict, granted.wavelength_pm) == (Verdict.GRANTED, PM[0])


ALICE, BOB, CHARLIE = "10.0.0.1", "10.0.0.2", "10.0.0.3"


def both_ways(count: int) -> Arbiter:
    """Return an arbiter of three hosts, each with two fibres of this number of channels."""
    network = Network({Q1})
    names = {"alice": ALICE, "bob": BOB, "charlie": CHARLIE}
    for place, (name, address) in enumerate(names.items()):
        for number in (0, 1):
            ports = channels(network, SwitchPort(Q1, 1 + 2 * place + number), count)
            for channel, at in enumerate(ports):
                # As the topology names them: fibre by fibre.
                label = HostPort(name, address, f"{name}-q{number * count + channel}")
                network.attach(at, label)
    return Arbiter(network, 5.0, 30.0)


def test_with_two_channels_both_hosts_send_and_receive_at_once() -> None:
    state = both_ways(2)
    sdc = Setup(1, Service.SDC, Handshake.FRAMED, CHARLIE, 1, 1, 1, wavelength_pm=ANY_WAVELENGTH)
    there = {"sport": 40_001, "source": ALICE, "destination": BOB}
    back = {"sport": 40_002, "source": BOB, "destination": ALICE}
    for ends, number, wavelength_pm in ((there, 1, PM[0]), (back, 2, PM[1])):
        sent = frame(replace(sdc, session=number).encode(), **ends)  # type: ignore[arg-type]
        granted = answer(obeyed(state, state.segment_arrived(S1, 1, sent, 0.0), 0.0))
        assert (granted.verdict, granted.wavelength_pm) == (Verdict.GRANTED, wavelength_pm)
    taken = state.sessions.occupied
    # charlie's first fibre to alice's, hers to bob's second, charlie's second to bob's first.
    assert {way: 1 for way in taken if way.port < 1000} == {
        Direction(Q1, port, inward): 1
        for port, inward in ((5, True), (1, False), (1, True), (4, False), (6, True), (3, False))
    }
    assert sum(way.port > 1000 for way in taken) == 6
    assert set(taken.values()) == {1, 2}


def test_with_one_channel_the_second_direction_is_busy() -> None:
    state = both_ways(1)
    sdc = Setup(1, Service.SDC, Handshake.FRAMED, CHARLIE, 1, 1, 1, wavelength_pm=ANY_WAVELENGTH)
    reasons = []
    for number, (source, destination) in enumerate(((ALICE, BOB), (BOB, ALICE)), 1):
        ends = {"sport": 40_000 + number, "source": source, "destination": destination}
        sent = frame(replace(sdc, session=number).encode(), **ends)  # type: ignore[arg-type]
        actions = obeyed(state, state.segment_arrived(S1, 1, sent, 0.0), 0.0)
        reasons.append(answer(actions).reason)
    assert reasons == [Reason.OK, Reason.BUSY]


def test_a_successor_knows_the_channel_of_a_session() -> None:
    state = trunk()
    ask(state, bb84(1), pair(1))
    ask(state, bb84(2), pair(2))
    kept = decode_session(encode_session(state.sessions.by_number[2]), 10.0)
    assert (kept.setup.wavelength_pm, kept.frequency_mhz) == (ANY_WAVELENGTH, MHZ[1])
