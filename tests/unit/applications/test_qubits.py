"""Qubits for programs on hosts, over whole stacks with a real dispatcher."""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TextIO

import pytest
from dispatcher_status import require_nothing_left
from limits import SOON_S
from stacks_scene import network

from applications.qubits import Processor
from hosts import network_loop
from hosts.stack_socket import QuantumSocketError

Program = Callable[[Processor], Any]


def played(folder: Path, paths: list[tuple[int, int]], **programs: Program) -> dict[str, Any]:
    """Run a program at each host; return what each has returned."""

    def play(host: str, program: Program) -> Any:
        with Processor(folder / f"{host}.sock") as processor:
            return program(processor)

    def perform() -> dict[str, Any]:
        with ThreadPoolExecutor(len(programs)) as pool:
            playing = {host: pool.submit(play, host, each) for host, each in programs.items()}
            reports = {host: each.result(SOON_S) for host, each in playing.items()}
        require_nothing_left(folder)
        return reports

    async def run() -> dict[str, Any]:
        async with network(folder, paths=paths):
            return await asyncio.to_thread(perform)

    return network_loop.run(run())


def test_gates_act_as_they_are_called(tmp_path: Path) -> None:
    def alice(processor: Processor) -> list[int]:
        found = []
        for gates in (
            ["x"],
            ["y"],
            ["z"],
            ["h", "z", "h"],
            ["h", "s", "s", "h"],
            ["h", *"tttt", "h"],
        ):
            qubit = processor.qubit()
            for gate in gates:
                getattr(qubit, gate)()
            found.append(qubit.measure())
        for axis in "xyz":
            qubit = processor.qubit()
            qubit.rotate(axis, 5, 3)
            qubit.rotate(axis, 3, 3)
            found.append(qubit.measure())
        one, other, third = (processor.qubit() for _ in range(3))
        one.x()
        one.cnot(other)
        third.h()
        third.cz(other)
        third.h()
        return [*found, one.measure(), other.measure(), third.measure()]

    report = played(tmp_path, [], alice=alice)
    assert report["alice"] == [1, 1, 0, 1, 1, 1, 1, 1, 0, 1, 1, 1]


@pytest.mark.parametrize("basis", "XZ")
def test_pairs_agree(tmp_path: Path, basis: str) -> None:
    def measured(halves: Any) -> list[int]:
        for half in halves:
            if basis == "X":
                half.h()
        return [half.measure() for half in halves]

    report = played(
        tmp_path,
        [(4, 1), (5, 2)],
        alice=lambda processor: measured(processor.create_pairs("bob", 20)),
        bob=lambda processor: measured(processor.receive_pairs("alice", 20)),
    )
    assert report["alice"] == report["bob"]
    assert {0, 1} == set(report["alice"])


def test_what_cannot_be_is_refused_by_name(tmp_path: Path) -> None:
    def alice(processor: Processor) -> None:
        with pytest.raises(ValueError, match="host 'dora': choose one of alice, bob"):
            processor.create_pairs("dora")
        with pytest.raises(ValueError, match="300 qubits: 255 of 255 are free"):
            processor.create_pairs("bob", 300)
        qubit = processor.qubit()
        qubit.measure()
        qubit.x()
        with pytest.raises(QuantumSocketError, match="qubit 0 is not allocated"):
            qubit.measure()

    played(tmp_path, [], alice=alice)


def test_who_watches_sees_the_instructions(tmp_path: Path) -> None:
    def alice(processor: Processor) -> int:
        qubit = processor.qubit()
        qubit.rotate("y", 3, 2)
        return qubit.measure()

    reports = subroutines(tmp_path, alice)
    assert reports == [
        "set Q0 0; qalloc Q0; init Q0; set Q0 0; rot_y Q0 3 2; set Q0 0; meas Q0 M0; qfree Q0; "
        "ret_reg M0"
    ]


def test_of_a_long_subroutine_the_beginning_is_seen(tmp_path: Path) -> None:
    def alice(processor: Processor) -> None:
        qubit = processor.qubit()
        for _ in range(300):
            qubit.x()
        processor.flush()

    (reports,) = subroutines(tmp_path, alice)
    assert len(reports) < 1100
    assert reports.startswith("set Q0 0; qalloc Q0; init Q0; set Q0 0; x Q0; set Q0 0; x Q0;")
    assert reports.endswith("; ... of 603 instructions")


def subroutines(folder: Path, program: Program) -> list[str]:
    """Return what the event log says of subroutines while alice runs a program."""

    def perform() -> None:
        with Processor(folder / "alice.sock") as processor:
            program(processor)

    async def run(events: TextIO) -> None:
        async with network(folder, paths=[], events=events):
            await asyncio.to_thread(perform)

    with (folder / "quantum.log").open("w") as events:
        network_loop.run(run(events))
    lines = (folder / "quantum.log").read_text().splitlines()
    parts = [line.partition(" subroutine ") for line in lines]
    assert all(before.split()[-1] == "alice" for before, found, _text in parts if found)
    return [text.strip() for _before, found, text in parts if found]
