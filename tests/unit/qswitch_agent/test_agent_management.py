"""The flow monitor's connection, with a bridge that says what the test says."""

import asyncio
from asyncio import StreamReader, StreamWriter
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from qswitch_agent.management import BridgeFault, Management

from qswitch_agent.openflow import (
    HEADER,
    MULTIPART,
    PAUSED,
    PORT,
    RESUMED,
    FlowUpdate,
    PortState,
    encode,
    flow_monitor_request,
    hello,
    port_watch,
)

DEADLINE_S = 5.0
START = hello() + flow_monitor_request(1) + port_watch(2)


def play(scene: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(scene, DEADLINE_S))


class Bridge:
    """A bridge's management socket, and the agent's end of it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.updates: list[FlowUpdate] = []
        self.ports: list[PortState] = []
        self.agent = Management(str(path), self.updates.extend, self.ports.extend)

    async def __aenter__(self) -> "Bridge":
        connected: asyncio.Queue[tuple[StreamReader, StreamWriter]] = asyncio.Queue()
        self.server = await asyncio.start_unix_server(
            lambda *ends: connected.put_nowait(ends), self.path
        )
        await self.agent.open()
        self.reader, self.writer = await connected.get()
        self.running = asyncio.create_task(self.agent.run())
        assert await self.reader.readexactly(len(START)) == START
        return self

    async def __aexit__(self, *_error: object) -> None:
        self.running.cancel()
        self.agent.close()
        self.writer.close()
        self.server.close()

    async def barrier(self) -> int:
        """Return the xid of the barrier that the agent sends next."""
        _version, kind, _length, xid = HEADER.unpack(await self.reader.readexactly(HEADER.size))
        assert kind == ofp.OFPT_BARRIER_REQUEST
        return int(xid)

    def says(self, kind: int, xid: int, body: bytes = b"") -> None:
        self.writer.write(encode(kind, xid, body))

    def monitors(self, event: int) -> None:
        body = MULTIPART.pack(ofp.OFPMP_FLOW_MONITOR, 0) + bytes([0, 8, 0, event, 0, 0, 0, 0])
        self.says(ofp.OFPT_MULTIPART_REPLY, 0, body)


def test_missing_bridge_is_named(tmp_path: Path) -> None:
    async def scene() -> None:
        with pytest.raises(BridgeFault, match=r"no bridge at .*q7\.mgmt"):
            await Management(str(tmp_path / "q7.mgmt"), print, print).open()

    play(scene())


def test_synchronised_after_the_barrier_of_its_own(tmp_path: Path) -> None:
    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            first = asyncio.create_task(bridge.agent.synchronise())
            one = await bridge.barrier()
            second = asyncio.create_task(bridge.agent.synchronise())
            other = await bridge.barrier()
            bridge.says(ofp.OFPT_BARRIER_REPLY, other)
            await second
            assert not first.done()
            bridge.says(ofp.OFPT_BARRIER_REPLY, one)
            await first

    play(scene())


def test_pause_of_the_monitor_is_waited_out(tmp_path: Path) -> None:
    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            waiting = asyncio.create_task(bridge.agent.synchronise())
            xid = await bridge.barrier()
            bridge.monitors(PAUSED)
            bridge.says(ofp.OFPT_BARRIER_REPLY, xid)
            bridge.says(ofp.OFPT_ECHO_REQUEST, 5, b"in between")
            echo = encode(ofp.OFPT_ECHO_REPLY, 5, b"in between")
            assert await bridge.reader.readexactly(len(echo)) == echo
            assert not waiting.done()
            bridge.monitors(RESUMED)
            await waiting
            assert [update.event for update in bridge.updates] == [PAUSED, RESUMED]

    play(scene())


def test_ports_are_handed_over_as_they_are_and_as_they_change(tmp_path: Path) -> None:
    def port(number: int, config: int = 0, state: int = 0) -> bytes:
        return PORT.pack(number, PORT.size, bytes(6), b"q1-eth", config, state)

    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            ports = port(1) + port(2, config=ofp.OFPPC_PORT_DOWN) + port(3, state=4)
            reply = MULTIPART.pack(ofp.OFPMP_PORT_DESC, 0) + ports
            bridge.says(ofp.OFPT_MULTIPART_REPLY, 2, reply)
            modified = bytes([ofp.OFPPR_MODIFY]) + bytes(7)
            bridge.says(ofp.OFPT_PORT_STATUS, 0, modified + port(1, state=ofp.OFPPS_LINK_DOWN))
            bridge.says(ofp.OFPT_PORT_STATUS, 0, modified + port(2))
            bridge.says(ofp.OFPT_PORT_STATUS, 0, bytes([ofp.OFPPR_DELETE]) + bytes(7) + port(3))
            bridge.says(ofp.OFPT_ECHO_REQUEST, 5)
            await bridge.reader.readexactly(HEADER.size)
            told = [(state.number, state.up) for state in bridge.ports]
            first, then = [(1, True), (2, False), (3, True)], [(1, False), (2, True), (3, False)]
            assert told == first + then

    play(scene())


@pytest.mark.parametrize("length", [0, 39, 41])
def test_a_port_of_a_wrong_length_is_a_fault(tmp_path: Path, length: int) -> None:
    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            port = PORT.pack(1, length, bytes(6), b"", 0, 0)
            reply = MULTIPART.pack(ofp.OFPMP_PORT_DESC, 0) + port
            bridge.says(ofp.OFPT_MULTIPART_REPLY, 2, reply)
            with pytest.raises(BridgeFault, match=f"port 1 with length {length}"):
                await bridge.running
            assert bridge.ports == []

    play(scene())


def test_error_of_the_bridge_is_a_fault(tmp_path: Path) -> None:
    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            bridge.says(ofp.OFPT_ERROR, 1, bytes([0, 1, 0, 2]))
            with pytest.raises(BridgeFault, match=r"refuses to be watched.*\(1, 2\)"):
                await bridge.running

    play(scene())


@pytest.mark.parametrize(
    ("last_words", "fault"), [(b"", "is gone"), (b"\x01\x02\x00\x08" * 2, "OpenFlow version 0x1")]
)
def test_end_of_the_bridge_is_told_to_who_waits(
    tmp_path: Path, last_words: bytes, fault: str
) -> None:
    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            waiting = asyncio.create_task(bridge.agent.synchronise())
            await bridge.barrier()
            bridge.writer.write(last_words)
            bridge.writer.close()
            for task in (waiting, bridge.running):
                with pytest.raises(BridgeFault, match=fault):
                    await task

    play(scene())
