"""Orders that a host gives once for many blocks, or hears of only when something is wrong."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest
from dispatcher_status import held, status
from stacks_scene import OWN_ADDRESS, QNICS, arbitrated, live_qubits, network

from hosts import network_loop
from hosts.hardware.block_name import BlockName
from hosts.hardware.pair_light import begin_pairs, detect_pairs, modulate
from hosts.hardware.replies import Coincidences, HardwareError
from hosts.hardware.simulated import TIMES, SimulatedQnic
from hosts.hardware.steps import Pulses
from hosts.middleware.session.channel import MetadataChannel
from wire.dispatcher_pb2 import Step, TellRequest
from wire.metadata.blocks import Emission, Emitted
from wire.metadata.setup import Answer, Setup
from wire.metadata.vocabulary import Reason, Service

SESSION, RATE_HZ, WAVELENGTH_PM, TIMEOUT_S = 9, 50_000_000, 1_550_120, 10.0
PORTS = ("charlie-q0", "charlie-q1")
PULSES = Pulses(RATE_HZ, WAVELENGTH_PM)
BEHIND = Step(tell=TellRequest(text="behind that"))
# Each operator makes the Bell state of its own number of Phi+: X Psi+, Z Phi-, XZ Psi-.
PAULIS = np.array([0, 1, 2, 3, 2, 1], dtype=np.uint8)


class Hosts:
    """The hardware of charlie, alice and bob."""

    def __init__(self, folder: Path) -> None:
        dispatcher = f"unix:{folder}/dispatcher.sock"
        self.charlie, self.alice, self.bob = (
            SimulatedQnic(dispatcher, f"token of {name}", QNICS[name])
            for name in ("charlie", "alice", "bob")
        )

    async def light(self, number: int) -> None:
        """Send a block by way of alice to bob."""
        await begin_pairs(self.charlie, SESSION, number, 6, PORTS, PULSES)
        half = BlockName(SESSION, number, 0)
        await modulate(self.alice, half, np.roll(PAULIS, number), "alice-q0", PULSES, TIMEOUT_S)
        await self.charlie.finish(SESSION)

    async def detected(self, number: int) -> Coincidences:
        """Return what bob detects of a block, as he does of those behind it."""
        ports = "bob-q1", "bob-q0"
        return await detect_pairs(self.bob, SESSION, number, ports, TIMEOUT_S, following=True)


@asynccontextmanager
async def hosts(folder: Path) -> AsyncIterator[Hosts]:
    """Give the hardware of a network."""
    async with network(folder):
        made = Hosts(folder)
        try:
            yield made
        finally:
            for qnic in (made.charlie, made.alice, made.bob):
                await qnic.close()


def test_blocks_that_follow_are_measured_before_they_are_asked_for(tmp_path: Path) -> None:
    async def run() -> None:
        async with hosts(tmp_path) as made:
            for first in (1, TIMES + 1):  # that one order is for, and the next one
                asked = asyncio.create_task(made.detected(first))
                behind = range(first + 1, first + TIMES)
                for number in (first, *behind):
                    await made.light(number)
                assert await live_qubits(tmp_path) == 0
                found = [await asked, *[await made.detected(number) for number in behind]]
                for number, each in zip((first, *behind), found, strict=True):
                    assert each.outcomes.tolist() == np.roll(PAULIS, number).tolist()

    network_loop.run(run())


def test_who_asks_no_more_leaves_light_where_it_is(tmp_path: Path) -> None:
    async def run() -> None:
        async with hosts(tmp_path) as made:
            asked = asyncio.create_task(made.detected(1))
            await made.light(1)
            await asked
            waiting = asyncio.create_task(made.detected(2))
            await asyncio.sleep(0)
            waiting.cancel()
            await asyncio.wait([waiting])
            await made.bob.perform(BEHIND)
            await made.light(2)
            blocks = await asyncio.to_thread(held, tmp_path, "bob")
            assert [(each.block.number, each.photons) for each in blocks] == [(2, 6), (2, 6)]
            found = await made.detected(2)
            assert found.outcomes.tolist() == np.roll(PAULIS, 2).tolist()

    network_loop.run(run())


def test_who_asks_for_another_block_leaves_light_of_the_one_that_was_next(tmp_path: Path) -> None:
    async def run() -> None:
        async with hosts(tmp_path) as made:
            first = asyncio.create_task(made.detected(1))
            await made.light(1)
            await first
            other = asyncio.create_task(made.detected(5))
            await asyncio.sleep(0)
            await made.bob.perform(BEHIND)
            await made.light(2)
            blocks = await asyncio.to_thread(held, tmp_path, "bob")
            assert [(each.block.number, each.photons) for each in blocks] == [(2, 6), (2, 6)]
            await made.light(5)
            assert (await other).outcomes.tolist() == np.roll(PAULIS, 5).tolist()

    network_loop.run(run())


def test_pairs_that_cannot_be_made_are_heard_of_by_who_asks(tmp_path: Path) -> None:
    async def run() -> None:
        async with hosts(tmp_path) as made:
            charlie = made.charlie
            await begin_pairs(charlie, SESSION, 1, 6, PORTS, PULSES._replace(rate_hz=0))
            for _ in range(2):
                with pytest.raises(HardwareError, match="rate_hz is 0"):
                    await charlie.finish(SESSION)
            with pytest.raises(HardwareError, match="rate_hz is 0"):
                await begin_pairs(charlie, SESSION, 2, 6, PORTS, PULSES)
            await begin_pairs(charlie, SESSION + 1, 1, 6, PORTS, PULSES)
            await charlie.finish(SESSION + 1)
            await charlie.finish(SESSION + 2)  # of which nothing was begun
            await charlie.discard(SESSION)
            await charlie.finish(SESSION)  # nothing is heard of it any more
            await begin_pairs(charlie, SESSION, 3, 6, PORTS, PULSES)
            await charlie.finish(SESSION)

    network_loop.run(run())


def test_a_source_answers_when_all_light_that_was_ordered_is_over(tmp_path: Path) -> None:
    async def run() -> int:
        async with network(tmp_path):
            channel = await MetadataChannel.connect("charlie", OWN_ADDRESS["charlie"])
            setup = Setup(5, Service.PAIR_SOURCE, 1, OWN_ADDRESS["charlie"], 100, 1, 1000)
            await channel.request(arbitrated(setup, "charlie", channel))
            emissions = [Emission(5, block, 10, 1000) for block in range(1, 41)]
            channel.send(*emissions, Emitted(5, 40))
            assert (await channel.receive(Answer, TIMEOUT_S)).reason == Reason.OK
            channel.close()
            return (await asyncio.to_thread(status, tmp_path, "")).pairs_created

    assert network_loop.run(run()) == 400
