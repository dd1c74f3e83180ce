"""Files that a runner puts on another machine: both ends of the channel, over a pair of sockets."""

import asyncio
import socket
from asyncio import StreamWriter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import astuple, replace
from pathlib import Path
from threading import Thread
from typing import Any, Never

import pytest
from limits import SOON_S

from applications.keys.config import KeyManagerConfig
from topologies.system.machines.agent import Agent
from topologies.system.machines.machine import Machine
from topologies.system.processes.programs import NetworkError
from topologies.system.runs import runtime
from topologies.system.runs.elsewhere import carried
from topologies.system.runs.runtime import Runtime
from wire.config import Config, CopperConfig, HostConfig
from wire.credentials import Credentials, secret_file
from wire.machine_channel import MOST_BODY_BYTES
from wire.parameters.network import NetworkSettings

ABOUT = {"name": "m2", "root": "/", "python": "python"}


@pytest.fixture
def machine() -> Iterator[Machine]:
    """Give another machine, which is this one."""
    loop = asyncio.new_event_loop()
    thread = Thread(target=loop.run_forever, daemon=True)
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
        with suppress(ConnectionResetError):  # its last answer may be one that nobody reads
            await serving
        for writer in writers:
            writer.close()
            with suppress(ConnectionResetError):
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


class Elsewhere:
    """A run with bob on the other machine, which is this one: files are put where they are."""

    def __init__(self, machine: Machine, keys: str = "") -> None:
        self.machine = machine
        self.network = Runtime(NetworkSettings(keys=keys), places={"bob": machine})
        for number, name in enumerate(("alice", "bob", "charlie"), 1):
            self.network.addresses[name] = f"10.0.0.{number}"
        self.config = HostConfig(
            name="bob",
            address="10.0.0.2",
            qnics=[],
            dispatcher="10.0.0.4:50051",
            token="secret",
            socket=self.network.socket("bob"),
            hosts_file=self.network.hosts_file(),
            source="charlie",
            seed=1,
            pair_secrets=self.network.secrets_folder(),
            keys=self.network.key_folder("bob"),
            credentials=Credentials(*map(self.made, ("authority", "certificate", "key"))),
        )

    def made(self, name: str) -> str:
        """Return the path of a file of the run, made now."""
        file = self.network.folder / name
        file.write_text(name)
        return str(file)

    def carried(self, name: str, config: Config) -> Config:
        return carried(self.network, name, config, "bob", self.machine)


@pytest.fixture
def _own_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "run")


@pytest.mark.usefixtures("_own_runs")
def test_a_stack_elsewhere_has_its_files_and_no_secret_of_others(machine: Machine) -> None:
    run = Elsewhere(machine)
    shared = Path(run.config.pair_secrets)
    assert run.config.credentials is not None
    brought = [*map(Path, astuple(run.config.credentials)), Path(run.config.hosts_file)]
    before = [file.stat().st_ino for file in brought]
    of_others = secret_file(shared, "alice", "charlie")
    stays = of_others.stat().st_ino
    assert run.carried("bob", run.config) == run.config
    assert {file.name for file in shared.iterdir()} == {"alice:bob", "bob:charlie", of_others.name}
    assert of_others.stat().st_ino == stays
    assert all(file.stat().st_ino != at for file, at in zip(brought, before, strict=True))
    assert Path(run.config.socket).is_socket()  # what connects to it reaches the stack there


@pytest.mark.usefixtures("_own_runs")
@pytest.mark.parametrize("is_lost", [False, True])
def test_keys_come_back_from_elsewhere_unless_their_machine_is_lost(
    machine: Machine, tmp_path: Path, is_lost: bool
) -> None:
    run = Elsewhere(machine, keys=str(tmp_path / "kept"))
    run.carried("bob", run.config)
    Path(run.config.keys, "1.key").write_bytes(b"own")
    if is_lost:
        asyncio.run_coroutine_threadsafe(machine.close(), machine._loop).result(SOON_S)
    run.network.from_elsewhere.close()
    kept = tmp_path / "kept" / "bob" / "1.key"
    assert (kept.read_bytes() if kept.exists() else b"") == (b"" if is_lost else b"own")


@pytest.mark.usefixtures("_own_runs")
def test_hardware_of_ones_own_is_refused_elsewhere(machine: Machine) -> None:
    run = Elsewhere(machine)
    with pytest.raises(NetworkError, match=r"^bob: hardware of one's own is on the first machine"):
        run.carried("bob", replace(run.config, qnic="own.py:Dimmed"))
    with pytest.raises(NetworkError, match=r"^c0 runs on the first machine alone: place bob there"):
        run.carried("c0", CopperConfig([], "10.0.0.4"))


@pytest.mark.usefixtures("_own_runs")
def test_a_program_elsewhere_has_files_of_its_own_and_its_key_log_comes_back(
    machine: Machine, tmp_path: Path
) -> None:
    run, key_log = Elsewhere(machine), tmp_path / "keys.log"
    files: Any = {name: run.made(name) for name in KeyManagerConfig.FILES}
    config = KeyManagerConfig("bob", "10.0.0.2", "", "", {}, {}, **files, key_log=str(key_log))
    there = run.carried("kme-bob", config)
    assert isinstance(there, KeyManagerConfig)
    own = run.network.folder / "kme-bob"
    for name in files:
        assert Path(getattr(there, name)) == own / name
        assert (own / name).read_text() == name
    Path(there.key_log).write_bytes(b"secrets")
    assert not key_log.exists()
    run.network.from_elsewhere.close()
    assert key_log.read_bytes() == b"secrets"
