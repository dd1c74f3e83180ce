"""Messages over a connection that ends."""

import asyncio

import pytest

from hosts.middleware.session.channel import MetadataChannel, SessionError
from wire.metadata import Answer, Finish, Reason


async def heard_after(loss: bool) -> str:
    """Return what a refusal says, read before or after its connection is lost."""
    server = await asyncio.start_server(lambda _reader, writer: writer.close(), "127.0.0.1", 0)
    async with server:
        _, writer = await asyncio.open_connection(*server.sockets[0].getsockname())
        said = asyncio.StreamReader()
        said.feed_data(Answer(1, Reason.PROTOCOL, "a fibre is cut").encode())
        said.feed_eof()
        channel = MetadataChannel(said, writer)
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
    assert asyncio.run(heard_after(loss)) == "a fibre is cut"
