"""Messages between a runner and its agents: golden bytes, and what is refused."""

import asyncio

import pytest

from wire.machine_channel import LENGTHS, decode_header, encode, lengths, receive
from wire.malformed import MalformedPacket

HEADER = {"ask": 1, "do": "put"}
GOLDEN = bytes.fromhex("00000017 00000003") + b'{"ask": 1, "do": "put"}' + b"\x00\x01\x02"


def received(data: bytes) -> object:
    """Return what is read from a channel that says this and ends."""

    async def read() -> object:
        reader = asyncio.StreamReader()
        reader.feed_data(data)
        reader.feed_eof()
        return await receive(reader)

    return asyncio.run(read())


def test_a_message_is_these_bytes() -> None:
    assert encode(HEADER, b"\x00\x01\x02") == GOLDEN
    assert received(GOLDEN) == (HEADER, b"\x00\x01\x02")


@pytest.mark.parametrize("cut", range(1, len(GOLDEN)))
def test_a_message_that_is_cut_anywhere_is_read_whole(cut: int) -> None:
    async def read() -> object:
        reader = asyncio.StreamReader()
        reader.feed_data(GOLDEN[:cut])
        reading = asyncio.create_task(receive(reader))
        await asyncio.sleep(0)
        reader.feed_data(GOLDEN[cut:])
        return await reading

    assert asyncio.run(read()) == (HEADER, b"\x00\x01\x02")


@pytest.mark.parametrize("data", [b"", b"[]", b"1", b"{", b"\xff", b"[" * 100_000])
def test_a_header_that_is_no_object_is_refused(data: bytes) -> None:
    with pytest.raises(MalformedPacket):
        decode_header(data)


@pytest.mark.parametrize("sizes", [((1 << 20) + 1, 0), (0, (1 << 20) + 1)])
def test_what_is_too_long_is_refused_by_both_sides(sizes: tuple[int, int]) -> None:
    with pytest.raises(MalformedPacket):
        lengths(LENGTHS.pack(*sizes))
    with pytest.raises(ValueError, match="too long"):
        encode({"a": "a" * sizes[0]}, bytes(sizes[1]))
