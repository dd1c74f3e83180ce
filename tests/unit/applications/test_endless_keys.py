"""Sessions that make keys for as long as asked: keys are taken as they come, and memory is flat."""

import asyncio
import gc
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any
from weakref import ref

import pytest
from limits import SOON_S
from stacks_scene import accepted, network

from applications.key_distribution.key_handout import key_handout
from applications.qkd import keyring
from hosts import network_loop
from hosts.service_socket import ServiceSocket
from qmn.options import BadInput

PATHS = {"bb84": [(1, 2)], "bbm92": [(4, 1), (5, 2)]}
LOSS = {"bb84": 650.0, "bbm92": 325.0}  # 1 of 20 pulses is seen over fibres of 10 m
ENDS = "alice", "bob"
KEY_BITS = 20_000  # sifted; some 14,000 are left of them without an error

Summary = dict[str, Any]

protocols = pytest.mark.parametrize("protocol", list(PATHS))


def keys_made(
    folder: Path,
    protocol: str,
    heard: Callable[[Summary], None],
    physics: dict[str, Any] | None = None,
    **options: Any,
) -> list[Summary]:
    """Make keys; `heard` is called with each line, while the session goes on. Return summaries."""

    def session() -> list[Summary]:
        with ThreadPoolExecutor(1) as pool, ServiceSocket(folder / "alice.sock") as asking:
            listening: Future[None] = Future()
            bob = pool.submit(accepted, folder, protocol, listening)
            listening.result(SOON_S)
            asking.settimeout(SOON_S)
            for report in asking.request(protocol, ("bob", 9), **options):
                heard(report)
            asking.shutdown()
            return [asking.summary, bob.result(SOON_S)]

    async def run() -> list[Summary]:
        asyncio.get_running_loop().set_task_factory(remembered)
        async with network(folder, paths=PATHS[protocol], **(physics or {})):
            return await asyncio.to_thread(session)

    return network_loop.run(run())


def ignore(_summary: Summary) -> None:
    """Do nothing."""


TASKS: list["ref[asyncio.Task[Any]]"] = []  # gc.get_objects breaks tuples that threads make


def remembered(loop: Any, work: Any, **words: Any) -> "asyncio.Task[Any]":
    task: asyncio.Task[Any] = asyncio.Task(work, loop=loop, **words)
    TASKS.append(ref(task))
    return task


def results_of_light() -> int:
    """Return how many results of light that is over somebody still holds."""
    gc.collect()
    living = [task for each in TASKS if (task := each())]
    return sum(each.done() and each.get_name().startswith("light of ") for each in living)


@pytest.mark.by_day(every=2)
@protocols
def test_what_light_has_brought_is_held_no_longer_than_it_is_needed(
    tmp_path: Path, protocol: str
) -> None:
    """Each block brings a byte or more of each pulse: a session would grow by these."""
    held = list[int]()
    TASKS.clear()

    def heard(_summary: Summary) -> None:
        held.append(results_of_light())

    words: dict[str, Any] = {"sifted_per_key": 8000, "block_pairs": 65_536, "count": 4 * 8000}
    keys_made(tmp_path, protocol, heard, {"loss_db_per_km": LOSS[protocol]}, **words)
    assert len(held) > 20
    assert 0 < max(held) <= 4 * len(ENDS)


def test_a_session_lasts_for_the_seconds_that_are_asked_for(tmp_path: Path) -> None:
    """No key is begun later, and none is cut short."""
    words: dict[str, Any] = {"seconds": 1.5, "sifted_per_key": KEY_BITS, "block_pairs": 8192}
    for report in keys_made(tmp_path, "bb84", ignore, **words):
        assert report["elapsed_s"] >= 1.5
        assert report["keys"] > 0
        assert report["sifted_bits"] >= KEY_BITS


def test_a_session_goes_on_for_as_long_as_keys_are_taken_from_a_full_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It makes five times what its stores hold; both hosts hand out the same keys, each once."""
    monkeypatch.setattr(keyring, "CAPACITY", 100)
    stores, out = [tmp_path / "keys" / host for host in ENDS], tmp_path / "out"
    for store in stores:
        store.mkdir(mode=0o700, parents=True)
    words: dict[str, Any] = {"sifted_per_key": KEY_BITS, "block_pairs": 8192}
    over = Event()

    def take() -> None:
        while not over.wait(0.05):
            handed_out.take()

    folders = [str(store) for store in stores]
    with key_handout(out, ENDS, folders) as handed_out, ThreadPoolExecutor(1) as pool:
        taking = pool.submit(take)
        try:
            alice, bob = keys_made(tmp_path, "bb84", ignore, count=10 * KEY_BITS, **words)
        finally:
            over.set()
            taking.result(SOON_S)
    assert alice["keys"] == bob["keys"] == handed_out.count > 5 * 50
    ways = ENDS, ENDS[::-1]
    mine, theirs = ((out / host / f"{other}.keys").read_bytes() for host, other in ways)
    assert mine == theirs
    keys = {mine[start : start + 32] for start in range(0, len(mine), 32)}
    assert len(keys) == handed_out.count
    for store in stores:
        assert [path for path in store.rglob("*") if path.is_file()] == []


def test_keys_are_put_into_a_new_folder_alone(tmp_path: Path) -> None:
    (tmp_path / "alice").mkdir()
    (tmp_path / "alice" / "bob.keys").touch()
    words = tmp_path, ENDS, [str(tmp_path / "a"), str(tmp_path / "b")]
    with pytest.raises(BadInput, match="name a new folder"), key_handout(*words):
        pass
