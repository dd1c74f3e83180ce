"""Segments of one instant reach the arbiter by their connections, however they came."""

from ipaddress import IPv4Address

from stepping import SINCE_NS, stepping

from controller_apps.apps.ticks import Instants
from controller_apps.light.optics import SwitchPort
from wire.network_time import REAL_TIME, GateClient

S1 = SwitchPort(1, 1)


def frame(source: str, number: int) -> bytes:
    addresses = IPv4Address(source).packed + IPv4Address("10.0.0.9").packed
    return bytes(26) + addresses + b"\xc0\x00\x23\x32" + bytes([number])


def test_segments_of_one_instant_are_taken_by_the_addresses_of_their_hosts() -> None:
    """Those of one connection in the order in which they came."""
    came = [frame("10.0.0.2", 0), frame("10.0.0.1", 1), frame("10.0.0.1", 0)]
    with stepping() as gate:
        instants = Instants(gate.time, lambda: None)
        assert all(instants.keeps(S1, each) for each in came)
        other = GateClient(gate.time)
        other.wait_for(SINCE_NS + 1)  # the clock stands until the instant is over
        assert [each for _, each in instants.take()] == [came[1], came[2], came[0]]
        assert instants.take() == []
        instants.go_on()
        other.take_notice()
        other.close()
        instants.close()


def test_a_connection_is_opened_before_what_comes_on_it_at_the_same_instant() -> None:
    """Its other end has the larger address."""
    setup, answer = frame("10.0.0.1", 1), bytearray(frame("10.0.0.2", 0) + bytes(20))
    answer[47] = 0x12  # SYN, ACK
    with stepping() as gate:
        instants = Instants(gate.time, lambda: None)
        for each in (setup, bytes(answer)):
            instants.keeps(S1, each)
        assert [each for _, each in instants.take()] == [bytes(answer), setup]
        instants.close()


def test_paced_a_segment_is_not_kept() -> None:
    assert not Instants(REAL_TIME, lambda: None).keeps(S1, frame("10.0.0.1", 0))
