"""Requests of one instant of stepped time are done in the order of their nodes' names."""

import asyncio
import random
from itertools import permutations

from stepping import stepping

from dispatcher.server.turns import Turns
from programs.network_timers import close_timers, timers_of
from wire.network_time import DISPATCHER, REAL_TIME


def test_requests_of_one_instant_are_done_by_the_names_of_their_nodes() -> None:
    """However they come; those of one node in the order in which they came."""

    async def act() -> list[list[str]]:
        loop, orders = asyncio.get_running_loop(), []
        timers_of(loop, gate.time, DISPATCHER)
        turns = Turns(gate.time)
        for names in random.Random(5).sample(list(permutations("aabc")), 8):
            done: list[str] = []

            async def ask(number: int, node: str, done: list[str] = done) -> None:
                await turns.turn(node)
                done.append(f"{node}{number}")

            async with asyncio.TaskGroup() as group:
                for number, node in enumerate(names):
                    group.create_task(ask(number, node))
            orders.append(done)
        close_timers(loop)
        return orders

    with stepping() as gate:
        orders = asyncio.run(act())
        assert gate.time.now_s() == 0  # it took no time
    for done in orders:
        assert done == sorted(done)


def test_paced_what_comes_first_is_done_first() -> None:
    async def act() -> None:
        await asyncio.wait_for(Turns(REAL_TIME).turn("b"), 1)

    asyncio.run(act())
