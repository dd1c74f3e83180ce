"""The agent's own connections, with a bridge that says what the test says."""

import asyncio
from asyncio import StreamReader, StreamWriter
from pathlib import Path

import pytest
from openflow_messages import (
    ADDRESS,
    decoded,
    flow_update,
    light,
    monitor_reply,
    port,
    port_status,
)
from os_ken.ofproto import ofproto_v1_4 as ofp
from proxy_scene import End, play

from qswitch_agent.bridge import NO_PACKETS, BridgeFault, Commands, Monitor
from qswitch_agent.openflow import flow_reports, matches, messages, ports
from qswitch_agent.openflow.flow_reports import ADDED, PAUSED, RESUMED, FlowUpdate
from qswitch_agent.openflow.flows import FlowEntry
from qswitch_agent.openflow.messages import HEADER, encode, hello

START = hello() + flow_reports.flow_monitor_request(1) + ports.port_watch(2)


class Bridge:
    """A bridge's management socket, and the agent's end of it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.batches: list[list[FlowUpdate]] = []
        self.ports: list[ports.Port] = []
        self.agent = Monitor(str(path), self.batches.append, self.ports.extend)

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
        self.writer.write(monitor_reply(bytes([0, 8, 0, event, 0, 0, 0, 0])))


def test_missing_bridge_is_named(tmp_path: Path) -> None:
    async def scene() -> None:
        with pytest.raises(BridgeFault, match=r"no bridge at .*q7\.mgmt"):
            await Monitor(str(tmp_path / "q7.mgmt"), print, print).open()

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
            events = [[update.event for update in batch] for batch in bridge.batches]
            assert events == [[PAUSED], [RESUMED]]

    play(scene())


def test_ports_are_handed_over_as_they_are_and_as_they_change(tmp_path: Path) -> None:
    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            down = ofp.OFPPS_LINK_DOWN
            described = [port(1), port(2, config=ofp.OFPPC_PORT_DOWN), port(3, state=4)]
            parts = [one.encode() for one in described]
            bridge.writer.write(messages.reply(ofp.OFPMP_PORT_DESC, 2, parts))
            bridge.writer.write(port_status(port(1, state=down)))
            bridge.writer.write(port_status(port(2)))
            bridge.writer.write(port_status(port(3), ofp.OFPPR_DELETE))
            bridge.says(ofp.OFPT_ECHO_REQUEST, 5)
            await bridge.reader.readexactly(HEADER.size)
            reports = [(state.number, state.up) for state in bridge.ports]
            first, then = [(1, True), (2, False), (3, True)], [(1, False), (2, True), (3, False)]
            assert reports == first + then

    play(scene())


def test_updates_of_one_reply_are_one_batch(tmp_path: Path) -> None:
    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            first, second, third = (
                flow_update(ADDED, light(*path)) for path in ((1, 2), (2, 3), (3, 4))
            )
            bridge.writer.write(monitor_reply(first, more=True))
            bridge.says(ofp.OFPT_ECHO_REQUEST, 5)
            await bridge.reader.readexactly(HEADER.size)
            assert bridge.batches == []
            bridge.writer.write(monitor_reply(second) + monitor_reply(third))
            bridge.says(ofp.OFPT_ECHO_REQUEST, 6)
            await bridge.reader.readexactly(HEADER.size)
            entries = [[one.entry for one in batch if one.entry] for batch in bridge.batches]
            assert [[one.in_port for one in batch] for batch in entries] == [[1, 2], [3]]

    play(scene())


@pytest.mark.parametrize("length", [0, 39, 41])
def test_a_port_of_a_wrong_length_is_a_fault(tmp_path: Path, length: int) -> None:
    async def scene() -> None:
        async with Bridge(tmp_path / "q.mgmt") as bridge:
            wrong = ports.PORT.pack(1, length, bytes(6), b"", 0, 0)
            bridge.writer.write(messages.reply(ofp.OFPMP_PORT_DESC, 2, [wrong]))
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


async def commanded(path: Path) -> tuple[Commands, End, asyncio.Server]:
    """Return the agent's commands, and the end at which the bridge hears them."""
    connected: asyncio.Queue[End] = asyncio.Queue()
    server = await asyncio.start_unix_server(lambda *ends: connected.put_nowait(End(*ends)), path)
    commands = Commands(str(path))
    await commands.open()
    bridge = await connected.get()
    await bridge.hears(hello())
    return commands, bridge, server


def test_commands_delete_one_entry_and_keep_packets_out_of_fibres(tmp_path: Path) -> None:
    async def scene() -> None:
        commands, bridge, server = await commanded(tmp_path / "q.mgmt")
        commands.delete(FlowEntry(7, matches.of_port(1), 1, False, 2, 9))
        deleted = decoded(await bridge.next())
        assert (deleted.command, deleted.priority) == (ofp.OFPFC_DELETE_STRICT, 7)
        commands.keep_packets_out(port(3))
        commands.announce(port(4))
        mods = [ports.PortMod.decode(await bridge.next()) for _mod in range(3)]
        assert [(mod.number, mod.config) for mod in mods] == [
            (3, NO_PACKETS),
            (4, 0),
            (4, NO_PACKETS),
        ]
        assert {(mod.address, mod.mask) for mod in mods} == {(ADDRESS, NO_PACKETS)}
        commands.close()
        bridge.writer.close()
        server.close()

    play(scene())


def test_refused_command_is_logged_and_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scene() -> None:
        commands, bridge, server = await commanded(tmp_path / "q.mgmt")
        running = asyncio.create_task(commands.run())
        bridge.says(encode(ofp.OFPT_ERROR, 1, bytes([0, 7, 0, 4])))
        done = asyncio.create_task(commands.barrier())
        request = await bridge.next()
        bridge.says(encode(ofp.OFPT_BARRIER_REPLY, int.from_bytes(request[4:8], "big")))
        await done
        running.cancel()
        commands.close()
        bridge.writer.close()
        server.close()

    play(scene())
    assert "the bridge refuses what the agent asks: (7, 4)" in caplog.text
