"""The words of hosts to those who watch: one line each, and nothing that could pass for another."""

import pytest
import uvloop

from dispatcher.refusal import Refusal
from evidence.laboratory import Laboratory
from wire.config import DispatcherConfig
from wire.dispatcher_pb2 import TellRequest


def report(text: str) -> list[tuple[str, str, str]]:
    """Return the events after alice has reported a text."""
    laboratory = Laboratory(DispatcherConfig("", "", 1, {"alice": ""}, [], []))
    uvloop.run(laboratory.act("alice", "tell", TellRequest(text=text)))
    return [(e.node, e.kind, e.detail) for e in laboratory.layer.history._events]


def test_instructions_are_an_event_of_the_host_that_tells_them() -> None:
    assert report("set Q0 0; meas Q0 M0") == [("alice", "subroutine", "set Q0 0; meas Q0 M0")]
    assert report("x" * 4000)


@pytest.mark.parametrize("text", ["", "x" * 4001, "h Q0\n2026 bob measure", "\x1b[2J", "é", "\0"])
def test_what_is_not_one_line_of_a_log_is_refused(text: str) -> None:
    with pytest.raises(Refusal, match="1 to 4000 printable ASCII characters are allowed"):
        report(text)
