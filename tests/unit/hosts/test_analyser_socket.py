"""Outcomes of switches' analysers for blocks that are under way at once, over real sockets."""

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
from limits import SOON_S

from hosts.middleware.session.analyser_socket import MOST_ANALYSERS, AnalyserSocket, Swapped
from hosts.middleware.session.errors import SessionError
from wire.analyser_frames import MOST_OUTCOMES, AnalyserFrame, End, Receivers, frames_of, group_of
from wire.outcomes import NO_COINCIDENCE as LOST

SESSION, ANALYSER, MEMORY = 7, 60_001, 61_001
SIZE = MOST_OUTCOMES + 2  # two frames a block


@dataclass
class Copper:
    """The outcomes from switches and the heralds that reach a host."""

    frames: AnalyserSocket
    outcomes: socket.socket
    heralds: socket.socket

    def report(self, switch: int, number: int, outcomes: bytes) -> None:
        """Have a switch tell all outcomes of a block."""
        report = AnalyserFrame(ANALYSER, number, End.MEASURED, len(outcomes), 0, outcomes)
        for frame in frames_of(report):
            self.outcomes.send(
                frame.encode(group_of(SESSION), bytes([2, 0, 0, 0]) + switch.to_bytes(2))
            )

    def herald(self, number: int, held: bytes, to: Receivers = Receivers.OPENER) -> None:
        report = AnalyserFrame(MEMORY, number, End.STORED, len(held), 0, held)
        for frame in frames_of(report):
            self.heralds.send(frame.encode(group_of(SESSION, to), bytes(6)))

    def command(self, command: AnalyserFrame, to: Receivers = Receivers.OPENER) -> None:
        for frame in frames_of(command):
            self.heralds.send(frame.encode(group_of(SESSION, to), bytes(6)))

    def next(self, *sizes: int) -> list[Swapped]:
        """Return the outcomes of blocks at two switches, asked for at once."""

        async def found() -> list[Swapped]:
            with self.frames.reading():
                return await asyncio.gather(*(self.frames.next(size, 2) for size in sizes))

        return asyncio.run(found())


@contextmanager
def copper() -> Iterator[Copper]:
    """Give the opener's."""
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM) for _ in range(2)]
    try:
        for ours, _theirs in pairs:
            ours.setblocking(False)
        (outcomes, to_outcomes), (heralds, to_heralds) = pairs
        frames = AnalyserSocket(outcomes, heralds, SESSION, Receivers.OPENER)
        yield Copper(frames, to_outcomes, to_heralds)
    finally:
        for pair in pairs:
            for each in pair:
                each.close()


def test_blocks_under_way_get_the_outcomes_of_their_own_though_switches_are_not_in_step() -> None:
    with copper() as wire:
        for number, outcome in ((4, b"\1"), (5, b"\2")):
            wire.report(1, number, outcome * SIZE)
        for number, outcome in ((9, b"\0"), (10, b"\1")):
            wire.report(2, number, outcome * SIZE)
        first, second = wire.next(SIZE, SIZE)
    assert (set(first.outcomes), set(second.outcomes)) == ({1}, {3})
    assert [sorted(each.blocks[1::2]) for each in (first, second)] == [[4, 9], [5, 10]]
    assert first.positions.tolist() == second.positions.tolist() == list(range(SIZE))


def test_each_block_with_gaps_has_its_own_herald() -> None:
    """The first block met whole: its herald is not that of the second."""
    with copper() as wire:
        wire.herald(1, bytes(4))
        wire.herald(8, bytes([LOST, 0, LOST, 0]), Receivers.ACCEPTOR)
        wire.herald(2, bytes([LOST, 0, 0, LOST]))
        for switch in (1, 2):
            wire.report(switch, 1, bytes(4))
            wire.report(switch, 2, bytes(2))
        first, second = wire.next(4, 4)
    assert first.positions.tolist() == [0, 1, 2, 3]
    assert second.positions.tolist() == [1, 2]
    assert np.array_equal(second.outcomes, [0, 0])


def test_a_block_whose_outcomes_were_lost_ends_the_session() -> None:
    with copper() as wire:
        for switch in (1, 2):
            wire.report(switch, 1, bytes(4))
        wire.report(1, 2, bytes(4))
        wire.report(2, 3, bytes(4))
        with pytest.raises(SessionError, match="block 3 of inner port 60001 comes behind block 1"):
            wire.next(4, 4)


def test_a_herald_of_another_block_ends_the_session() -> None:
    with copper() as wire:
        wire.herald(1, bytes(3))
        for switch in (1, 2):
            wire.report(switch, 1, bytes(2))
        with pytest.raises(SessionError, match="a memory holds 3 pulses of a block of 4"):
            wire.next(4)


def test_rounds_of_purification_and_what_is_left_come_from_the_controller() -> None:
    """All outcomes of a purified block may be there before the controller names its pairs."""
    with copper() as wire:

        async def scene() -> tuple[Swapped, AnalyserFrame | None, AnalyserFrame | None]:
            with wire.frames.reading():
                found = asyncio.create_task(wire.frames.next(SIZE, 2, number=1))
                command = await wire.frames.round(1)
                for switch in (1, 2):
                    wire.report(switch, 1, b"\1" * 2)
                over = asyncio.create_task(wire.frames.round(1))
                await asyncio.sleep(0)
                assert not found.done()
                wire.command(AnalyserFrame(1, 1, End.PURIFY, 4, 0, bytes([LOST, 2, LOST, 0]), 3))
                return await found, command, await over

        round_ = AnalyserFrame(1, 1, End.PURIFY, SIZE, 0, bytes(SIZE), method=4)
        wire.command(round_, Receivers.ACCEPTOR)
        wire.command(round_)
        left, command, over = asyncio.run(scene())
    assert (command, over) == (round_, None)
    assert (left.positions.tolist(), left.outcomes.tolist(), left.rounds) == ([1, 3], [2, 0], 3)


@pytest.mark.parametrize(("pulses", "rounds"), [(5, 1), (4, 0)])
def test_pairs_left_of_no_round_or_beyond_the_block_end_the_session(
    pulses: int, rounds: int
) -> None:
    with copper() as wire:
        for switch in (1, 2):
            wire.report(switch, 1, bytes(4))
        wire.command(AnalyserFrame(1, 1, End.PURIFY, pulses, 0, bytes(pulses), rounds))

        async def found() -> Swapped:
            with wire.frames.reading():
                wire.frames._read()
                return await wire.frames.next(4, 2, number=1)

        with pytest.raises(SessionError, match=f"{pulses} pairs left of 4 by {rounds} rounds"):
            asyncio.run(found())


def test_an_answer_that_copper_does_not_take_ends_the_session() -> None:
    """Without rights to raw sockets as with them: each is an OSError."""
    with copper() as wire:
        command = AnalyserFrame(1, 1, End.PURIFY, 4, 0, bytes(4), method=4)
        wire.frames._copper = "no-such-copper"
        with pytest.raises(SessionError, match=r"no-such-copper: .* a round is not reported"):
            asyncio.run(wire.frames.answer(command, np.zeros(2, np.uint8)))


def test_analysers_beyond_the_most_are_not_heard() -> None:
    with copper() as wire:
        for switch in range(MOST_ANALYSERS + 1):
            wire.report(switch, 1, bytes(4))
            wire.frames._read()  # a socket holds few
        (found,) = wire.next(4)
    assert len(found.blocks) == 2 * MOST_ANALYSERS  # a place and a number of each


def test_frames_are_read_before_anybody_asks_for_their_block() -> None:
    """More than a socket holds: who sends them would wait for ever."""
    frames = 1000
    with copper() as wire:
        wire.heralds.setblocking(False)
        pulses = frames * MOST_OUTCOMES
        report = AnalyserFrame(MEMORY, 1, End.STORED, pulses, 0, bytes(pulses))

        async def answer() -> None:
            loop = asyncio.get_running_loop()
            with wire.frames.reading():
                for frame in frames_of(report):
                    data = frame.encode(group_of(SESSION, Receivers.OPENER), bytes(6))
                    await asyncio.wait_for(loop.sock_sendall(wire.heralds, data), SOON_S)

        asyncio.run(answer())


def test_pairs_that_stations_herald_are_as_many_as_of_the_poorest_link_without_a_memory() -> None:
    with copper() as scene:
        for port, outcomes in ((60_001, bytes([1, 3, 3])), (60_003, bytes([3, 3]))):
            heralded = AnalyserFrame(port, 1, End.HERALDED, len(outcomes), 0, outcomes, 50)
            scene.outcomes.send(heralded.encode(group_of(SESSION), bytes(6)))
        scene.report(1, 1, bytes([0, 2]))

        async def found() -> Swapped:
            with scene.frames.reading():
                return await scene.frames.next(4, 3, SOON_S)

        swapped = asyncio.run(found())
        assert swapped.outcomes.tolist() == [1 ^ 3 ^ 0, 3 ^ 3 ^ 2]
        assert swapped.positions.tolist() == [0, 1]
        assert swapped.attempts == 100


def test_a_link_without_a_pair_is_an_empty_block() -> None:
    with copper() as scene:
        for port, outcomes in ((60_001, bytes([1, 3])), (60_003, b"")):
            heralded = AnalyserFrame(port, 1, End.HERALDED, len(outcomes), 0, outcomes, 5000)
            scene.outcomes.send(heralded.encode(group_of(SESSION), bytes(6)))
        scene.report(1, 1, b"")

        async def found() -> Swapped:
            with scene.frames.reading():
                return await scene.frames.next(4, 3, limit_s=SOON_S)

        swapped = asyncio.run(found())
        assert swapped.outcomes.size == swapped.positions.size == 0
        assert swapped.attempts == 10_000
