"""The traces of a network on the machine."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from types import SimpleNamespace
from typing import cast

import pytest
from limits import SOON_S

from topologies.networks.network import Network, Signals
from topologies.networks.requirements import interfaces_of
from topologies.sdc import SdcTopo
from topologies.system.kernel import interfaces
from topologies.system.processes.forks import ForkServer
from topologies.system.processes.owners import this_process
from topologies.system.processes.programs import NetworkError
from topologies.system.runs import runtime
from topologies.system.runs.runtime import RECORD, Runtime
from wire.config import Cable


@pytest.fixture
def _no_umask() -> Iterator[None]:
    """Keep the modes with which files are created."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("_no_umask")
def test_nobody_else_reads_the_folder_of_tokens_and_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    network = Runtime()
    folder = Path(network.socket("dispatcher")).parent
    assert folder == tmp_path / "qmn" / str(this_process())
    assert folder.stat().st_mode & 0o777 == 0o700
    assert network.rest_token() == (folder / "rest-token").read_text()
    for file in (folder / "rest-token", network.private_file("openflow.keys")):
        assert file.stat().st_mode & 0o777 == 0o600
    keys = Path(network.key_folder("alice")).parent
    assert keys.stat().st_mode & 0o777 == 0o700


def test_the_folder_goes_although_a_file_is_made_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    network = Runtime()
    late = iter([network.folder / "alice.sock"])
    rmdir = os.rmdir

    def with_one_that_is_late(path: str, **more: int) -> None:
        for file in late:
            file.touch()
        rmdir(path, **more)

    monkeypatch.setattr(os, "rmdir", with_one_that_is_late)
    network.remove()
    assert not network.folder.exists()


def test_what_no_program_took_is_closed_with_a_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    network, ends, closed = Runtime(), os.pipe(), list[str]()
    network.cables.append(Cable("s1-eth1", "s2-eth1", *ends, 0.0))
    network.fork_server = cast("ForkServer", SimpleNamespace(close=lambda: closed.append("forks")))
    network.remove()
    assert closed == ["forks"]
    for end in ends:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(end)


def test_a_network_that_does_not_start_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    made = Runtime()
    assert made.folder.exists()
    with (
        Signals() as signals,
        pytest.raises(NetworkError, match="need root"),
        Network(SdcTopo, made, signals) as network,
    ):
        pytest.fail(f"{network} has started")
    assert not made.folder.exists()


def test_folders_of_runs_are_told_apart_by_their_owners(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "are_own", lambda: False)
    ended = this_process()._replace(start=1)
    for name in (str(this_process()), str(ended), "of-others"):
        (tmp_path / name).mkdir()
    (tmp_path / str(ended._replace(start=2))).touch()  # no folder
    assert runtime.folders_of_gone(tmp_path) == [tmp_path / str(ended)]
    assert runtime.folders_of_running(tmp_path) == [tmp_path / str(this_process())]


def test_interfaces_of_a_switch_are_those_that_begin_with_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interfaces, "INTERFACES", tmp_path)
    for name in ("s1", "s1-eth1", "s1-eth12", "s10-eth1", "s1-c0", "alice-eth0"):
        (tmp_path / name).mkdir()
    assert interfaces_of("s1") == ["s1", "s1-eth1", "s1-eth12"]


def test_a_file_of_an_earlier_network_begins_anew_and_is_kept_from_then_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    (tmp_path / "controller.jsonl").write_text("earlier\n")
    network = Runtime(log_folder=tmp_path)
    record = network.private_file("controller.jsonl")
    assert record.read_text() == ""
    record.write_text("now\n")
    assert network.private_file("controller.jsonl").read_text() == "now\n"
    (tmp_path / RECORD).write_text("earlier\n")
    assert not network.begun_anew(RECORD).exists()  # the dispatcher writes over no record


@pytest.mark.parametrize("shared", [Runtime.authority, Runtime.forks])
def test_hosts_that_start_at_once_share_what_the_first_of_them_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shared: Callable[[Runtime], object]
) -> None:
    monkeypatch.setattr(runtime, "RUNTIME_ROOT", tmp_path / "qmn")
    network, hosts = Runtime(), 8
    together = Barrier(hosts)

    def ask(_host: int) -> object:
        together.wait(SOON_S)
        return shared(network)

    with ThreadPoolExecutor(hosts) as pool:
        (one,) = set(pool.map(ask, range(hosts)))
    assert one is not None
    for program in network.programs:
        program.stop()
    network.remove()
