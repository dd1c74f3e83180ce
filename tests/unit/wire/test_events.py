"""The quantum event log."""

from wire.dispatcher_pb2 import BlockId, Event
from wire.events import format_line


def test_a_line_has_time_node_kind_block_and_counts() -> None:
    event = Event(
        time_ns=1_700_000_000_123_456_789,
        node="alice",
        kind="send",
        block=BlockId(session=0xAB, number=3, half=1),
        port="alice-q0",
        photons=8,
        lost=2,
    )
    assert format_line(event) == (
        "2023-11-14T22:13:20.123456789Z alice    send          "
        "session=00000000000000ab block=3/1 port=alice-q0 photons=8 lost=2"
    )
