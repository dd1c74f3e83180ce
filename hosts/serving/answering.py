"""Answers what applications ask about what a service has left them, such as pairs in memory."""

from hosts.hardware.qnic import HardwareError
from hosts.middleware.session.ends import Answerer
from hosts.middleware.session.errors import SessionError
from wire.metadata import Reason
from wire.socket_calls import Call, decode_fields, encode_fields


async def reply(answer: Answerer | None, question: bytes) -> bytes:
    """Return the message that answers a question, or says why not; a refusal ends nothing.

    Raise MalformedPacket for what is not a question.
    """
    fields = decode_fields(question)
    try:
        if answer is None:
            raise SessionError(Reason.UNSUPPORTED, "there is nothing here to ask about, or not yet")
        return encode_fields(Call.DONE, **await answer(fields))
    except (SessionError, HardwareError) as error:
        reason = error.reason if isinstance(error, SessionError) else Reason.HARDWARE
        return encode_fields(Call.DONE, refused=str(error), reason=reason)
