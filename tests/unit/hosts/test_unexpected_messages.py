"""Messages that have no place in a session, as the error that each of them is."""

import pytest

from hosts.middleware.session.errors import REMEDIES, SAME_VERSION, SessionError, unexpected
from wire.metadata.blocks import Finish, Report
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason

MISPLACED = "{} from bob in mid-session, where it has no place; " + SAME_VERSION


@pytest.mark.parametrize(
    ("message", "reason", "text"),
    [
        (None, Reason.PEER_GONE, "bob is gone: it closed the connection in mid-session"),
        (Answer(5, Reason.BUSY, "another one"), Reason.BUSY, "another one"),
        (Answer(5, Reason.BUSY, ""), Reason.BUSY, REMEDIES[Reason.BUSY]),
        (Answer(5, Reason.OK, ""), Reason.PROTOCOL, MISPLACED.format("Answer")),
        (Finish(5, 0, bytes(32)), Reason.PROTOCOL, MISPLACED.format("Finish")),
        (Report(5, 1, 4, 2, 3), Reason.PROTOCOL, MISPLACED.format("Report")),
    ],
)
def test_a_message_without_a_place_is_an_error_that_says_why(
    message: Message | None, reason: Reason, text: str
) -> None:
    error = unexpected(message, "bob")
    assert isinstance(error, SessionError)
    assert error.reason == reason
    assert str(error).startswith(text)
