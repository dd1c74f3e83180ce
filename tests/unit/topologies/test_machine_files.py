"""Files that a runner puts on another machine: both ends of the channel, over a pair of sockets."""

import asyncio
import socket
from asyncio import StreamWriter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Thread
from typing import Never

import pytest
from limits import SOON_S

from topologies.system.machines.agent import Agent
from topologies.system.machines.machine import Machine
from wire.machine_channel import MOST_BODY_BYTES

ABOUT = {"name": "m2", "root": "/", "python": "python"}


@pytest.fixture
def machine() -> Iterator[Machine]:
    """Give another machine, which is this one."""
    loop = asyncio.new_event_loop()
    thread = Thread(target=loop.run_forever)
    thread.start()
    ends = socket.socketpair()

    async def never() -> Never:
        raise AssertionError("nobody asks for a second connection")

    async def begin() -> tuple[Machine, list[StreamWriter], asyncio.Task[None]]:
        here, there = [await asyncio.open_connection(sock=end) for end in ends]
        agent = Agent(never, there)
        found = Machine(ABOUT, "127.0.0.2", "127.0.0.1", 1500, *here)
        return found, [here[1], there[1]], asyncio.create_task(agent.serve())

    async def end() -> None:
        await found.close()
        await serving
        for writer in writers:
            writer.close()
            await writer.wait_closed()

    found, writers, serving = asyncio.run_coroutine_threadsafe(begin(), loop).result(SOON_S)
    yield found
    asyncio.run_coroutine_threadsafe(end(), loop).result(SOON_S)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(SOON_S)
    loop.close()


def test_a_file_is_there_as_a_whole_for_its_owner_alone(machine: Machine, tmp_path: Path) -> None:
    data = bytes(range(256)) * (2 * MOST_BODY_BYTES // 256) + b"the end"
    there = tmp_path / "run" / "hosts.json"
    machine.put(there, data)
    assert there.read_bytes() == machine.get(there) == data
    assert there.stat().st_mode & 0o777 == 0o600
    machine.put(there, b"")
    assert machine.get(there) == b""
    assert [path.name for path in there.parent.iterdir()] == ["hosts.json"]


def test_who_reads_a_file_that_hosts_put_at_once_finds_one_of_them_whole(
    machine: Machine, tmp_path: Path
) -> None:
    """All hosts of a machine bring the list of hosts, which the first of them reads by then."""
    there = tmp_path / "hosts.json"
    contents = [sign * (2 * MOST_BODY_BYTES + 1) for sign in (b"0", b"1", b"2")]
    machine.put(there, contents[0])
    with ThreadPoolExecutor(2) as pool:
        putting = [pool.submit(machine.put, there, each) for each in contents[1:] * 4]
        found = [there.read_bytes()]
        while not all(each.done() for each in putting):
            found.append(there.read_bytes())
        for each in putting:
            each.result()
    found.append(there.read_bytes())
    assert {*found} <= {*contents}
    assert found[-1] != contents[0]
