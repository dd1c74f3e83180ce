"""Messages on a byte stream."""

import asyncio

import pytest

from wire import dispatcher_service
from wire.malformed import MalformedPacket


def read_all(data: bytes) -> list[bytes]:
    """Return the messages that a stream holds until it ends."""

    async def read() -> list[bytes]:
        stream, messages = asyncio.StreamReader(), list[bytes]()
        stream.feed_data(data)
        stream.feed_eof()
        while not stream.at_eof():
            messages.append(await dispatcher_service.read(stream))
        return messages

    return asyncio.run(read())


def test_a_message_goes_behind_its_length() -> None:
    assert dispatcher_service.encode(b"light") == bytes.fromhex("00000005") + b"light"


def test_messages_come_out_as_they_went_in() -> None:
    messages = [b"", b"light", bytes(dispatcher_service.MAX_LENGTH)]
    assert read_all(b"".join(map(dispatcher_service.encode, messages))) == messages


@pytest.mark.parametrize("length", range(1, 9))
def test_a_message_that_is_cut_short_is_the_end(length: int) -> None:
    with pytest.raises(EOFError):
        read_all(dispatcher_service.encode(b"light")[:length])


def test_a_message_that_is_too_long_is_malformed_before_it_is_there() -> None:
    with pytest.raises(MalformedPacket, match="1048577 bytes"):
        read_all(dispatcher_service.LENGTH.pack(dispatcher_service.MAX_LENGTH + 1))
