"""Whole stacks of alice, repeaters and bob over loopback, with a real dispatcher.

    alice-q0 --> r1-q0, r1-q1 --> r2-q0, ... --> bob-q0        all by way of q1

The relay that stands for the controller orders the repeaters when alice asks for a swap.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from itertools import chain as chain_of
from itertools import pairwise
from pathlib import Path
from typing import Any

from stacks_scene import RELAYED, REPEATERS, Judge, grant, network, requested

from controller_apps.policy.schedules import PARALLEL, UNPURIFIED, Purification
from controller_apps.sessions.actions import SwapsOrdered
from controller_apps.sessions.chains import orders
from controller_apps.sessions.sessions import Stop
from hosts import network_loop
from hosts.stack import Stack
from wire.device import MAX_UNDER_WAY
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Service

Stacks = dict[str, Stack]


def nodes(repeaters: int) -> list[str]:
    """Return the names of a chain, in order."""
    return ["alice", *REPEATERS[:repeaters], "bob"]


def order_swaps(
    stacks: Stacks,
    session: int,
    schedule: str = PARALLEL,
    purification: Purification = UNPURIFIED,
    blocks: int = MAX_UNDER_WAY,
) -> None:
    """Tell the nodes of a chain what to do in a session, as a controller does."""
    addresses = [RELAYED[name] for name in stacks]
    right = [0, *[1] * (len(addresses) - 2), 0]
    stops = tuple(Stop(address, 0, out) for address, out in zip(addresses, right, strict=True))
    ordered = SwapsOrdered(session, stops, schedule, purification, blocks)
    for stack, order in zip(stacks.values(), orders(ordered, 1).values(), strict=True):
        stack.swaps.take(order)


@asynccontextmanager
async def chain(
    folder: Path,
    repeaters: int,
    order: Callable[[Stacks, int], None] = order_swaps,
    verdict: Judge = grant,
    **physics: Any,
) -> AsyncIterator[Stacks]:
    """Run a chain; give its stacks, in order."""
    names, stacks = nodes(repeaters), Stacks()

    def judge(setup: Setup) -> Setup:
        if setup.service == Service.SWAP:
            order(stacks, setup.session)
        return verdict(setup)

    qnics = {name: [f"{name}-q0", f"{name}-q1"] for name in names}
    qnics |= {"alice": ["alice-q0"], "bob": ["bob-q0"]}
    ports = {port: number for number, port in enumerate(chain_of(*qnics.values()), 1)}
    paths = [(ports[qnics[left][-1]], ports[qnics[right][0]]) for left, right in pairwise(names)]
    scene = {"qnics": qnics, "ports": ports, "paths": paths, "stacks": stacks}
    async with network(folder, judge, **{**scene, **physics}):
        yield stacks


def swapped(folder: Path, repeaters: int, **options: Any) -> list[dict[str, Any]]:
    """Run a chain for one request; return the summaries of alice and bob."""
    physics = options.pop("physics", {})

    async def run() -> list[dict[str, Any]]:
        async with chain(folder, repeaters, **physics):
            return await asyncio.to_thread(requested, folder, "swap", **options)

    return network_loop.run(run())
