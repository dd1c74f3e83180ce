"""Messages over a connection that ends."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from limits import SOON_S

from hosts import network_loop
from hosts.middleware.session import channel as channels
from hosts.middleware.session.channel import MetadataChannel
from hosts.middleware.session.errors import SessionError
from wire.metadata.blocks import Emit, Finish
from wire.metadata.header import Message
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Handshake, Reason, Service


async def heard_after(loss: bool) -> str:
    """Return what a refusal says, read before or after its connection is lost."""
    server = await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", 0)
    async with server:
        _, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        text = asyncio.StreamReader()
        text.feed_data(Answer(1, Reason.PROTOCOL, "a fibre is cut").encode())
        text.feed_eof()
        channel = MetadataChannel(text, writer)
        if loss:
            writer.transport.abort()
            with pytest.raises(ConnectionError):
                await writer.drain()
        with pytest.raises(SessionError) as caught:
            await channel.receive(Finish, 5)
        channel.close()
        return str(caught.value)


@pytest.mark.parametrize("loss", [False, True])
def test_what_the_peer_said_before_the_connection_was_lost_is_heard(loss: bool) -> None:
    assert network_loop.run(heard_after(loss)) == "a fibre is cut"


async def said_after_loss(say: Callable[[MetadataChannel], Awaitable[None]]) -> Message | None:
    """Say something over a connection that is lost; return what is heard from then on."""
    server = await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", 0)
    async with server:
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        channel = MetadataChannel(reader, writer)
        writer.transport.abort()
        with pytest.raises(ConnectionError):
            await writer.drain()
        await say(channel)
        return await channel.next(5)


async def send(channel: MetadataChannel) -> None:
    channel.send(Emit(1, 2, 30, 4000))


async def give_up(channel: MetadataChannel) -> None:
    await channel.give_up(SessionError(Reason.PROTOCOL, "a fibre is cut"))


@pytest.mark.parametrize("say", [send, MetadataChannel.end, give_up])
def test_what_is_said_to_a_peer_that_is_gone_is_no_error_and_its_end_is_heard(
    say: Callable[[MetadataChannel], Awaitable[None]],
) -> None:
    """uvloop, other than asyncio, raises RuntimeError for a write to a connection that is lost."""
    assert network_loop.run(said_after_loss(say)) is None


async def heard_byte_by_byte(sent: list[Message]) -> list[Message | None]:
    """Return what a channel makes of messages whose every byte comes alone, up to their end."""
    server = await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", 0)
    async with server:
        _, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        coming = asyncio.StreamReader()
        channel = MetadataChannel(coming, writer)
        reading = asyncio.create_task(_all_of(channel))
        for byte in b"".join(message.encode() for message in sent):
            for _turn in range(10):  # of the loop: the channel takes what there is
                await asyncio.sleep(0)
            coming.feed_data(bytes([byte]))
        coming.feed_eof()
        heard = await asyncio.wait_for(reading, SOON_S)
        channel.close()
        return heard


async def _all_of(channel: MetadataChannel) -> list[Message | None]:
    heard = [await channel.next(5)]
    while heard[-1] is not None:
        heard.append(await channel.next(5))
    return heard


def test_messages_may_come_in_pieces_of_one_byte() -> None:
    sent: list[Message] = [
        Answer(1, Reason.OK, "all is well"),
        Emit(1, 2, 30, 4000),
        Finish(1, 5, bytes(range(32))),
    ]
    assert network_loop.run(heard_byte_by_byte(sent)) == [*sent, None]


async def unanswered(message: Message) -> SessionError:
    """Return the result of a request that is taken and never answered."""
    open_ones: list[asyncio.StreamWriter] = []
    server = await asyncio.start_server(lambda _, writer: open_ones.append(writer), "127.0.0.1", 0)
    async with server:
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        channel = MetadataChannel(reader, writer)
        with pytest.raises(SessionError) as caught:
            await channel.request(message, 0.05)
        channel.close()
        for each in open_ones:
            each.close()
        return caught.value


SETUP = Setup(1, Service.SDC, Handshake.FRAMED, "10.0.0.3", 9, 9, 9)


@pytest.mark.parametrize(
    ("message", "asked"), [(SETUP, "are it and the controller"), (Emit(1, 2, 3, 4), "is it")]
)
def test_of_a_set_up_that_nobody_answers_the_controller_is_asked_for_too(
    message: Message, asked: str
) -> None:
    error = network_loop.run(unanswered(message))
    assert str(error).endswith(f" in 0.05 s: {asked} still up?")
    assert error.reason == Reason.NO_ANSWER


async def broken_off(text: bytes) -> SessionError:
    """Return the result of an answer of which only this arrives."""
    reader = asyncio.StreamReader()
    reader.feed_data(text)
    reader.feed_eof()
    server = await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", 0)
    async with server:
        _, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        channel = MetadataChannel(reader, writer)
        with pytest.raises(SessionError) as caught:
            await channel.receive(Answer, 5)
        channel.close()
        return caught.value


@pytest.mark.parametrize("text", [b"", Answer(1, Reason.OK, "all is well").encode()[:-1]])
def test_a_connection_that_ends_is_no_fault_of_the_protocol(text: bytes) -> None:
    assert network_loop.run(broken_off(text)).reason == Reason.PEER_GONE


async def not_connected(monkeypatch: pytest.MonkeyPatch) -> SessionError:
    """Return the result of a connection to a port where nobody listens."""
    server = await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", 0)
    monkeypatch.setattr(channels, "METADATA_PORT", server.sockets[0].getsockname()[1])
    server.close()
    await server.wait_closed()
    with pytest.raises(
        SessionError, match=r"bob \(127\.0\.0\.1\) does not answer on port "
    ) as caught:
        await MetadataChannel.connect("bob", "127.0.0.1")
    return caught.value


def test_a_host_that_takes_no_connection_is_not_one_that_is_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert network_loop.run(not_connected(monkeypatch)).reason == Reason.NO_ANSWER
