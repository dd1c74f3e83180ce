r"""Keeps the stores of a host filled: opens sessions, and takes part in those of others.

    keys of one direction
    high ........  .          .        sessions, one after another, until both directions have
           .     ./   \      /         batches; then none until one has fewer than low
    low  ...\.../......\..../......
             ^ consumed, sessions again

A session that fails is followed by another after a pause that doubles each time, so that links
come back by themselves when a fibre is mended, or an eavesdropper has gone. One line of JSON
says what became of each.
"""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial

from applications.key_distribution.options import KeyOptions
from applications.keys.config import KEY_LINK_PORTS, KeyLink, KeyManagerConfig
from applications.keys.delivery import KeyDelivery
from applications.keys.link_states import KeyLinkStates
from applications.keys.sessions import Outcome, StackGone, hold, listening, offered
from applications.timeouts import FILLING_PAUSE_S
from hosts.network_loop import background_sleep
from hosts.timeouts import CHECK_PERIOD_S


async def fill(config: KeyManagerConfig, delivery: KeyDelivery, states: KeyLinkStates) -> None:
    """Keep all stores filled; StackGone when the host's stack has ended."""
    try:
        async with asyncio.TaskGroup() as group:
            for link in config.links:
                if link.opens:
                    group.create_task(_keep(config, delivery, states, link))
            for protocol in taken_part_in(config):
                group.create_task(_take_part(config, delivery, states, protocol))
            group.create_task(asyncio.Event().wait())  # without links there is nothing to end
    except ExceptionGroup as faults:
        gone, others = faults.split(StackGone)
        if others is not None or gone is None:
            raise
        raise StackGone(str(gone.exceptions[0])) from faults


def taken_part_in(config: KeyManagerConfig) -> set[str]:
    return {link.protocol for link in config.links if not link.opens}


@asynccontextmanager
async def open_to_others(config: KeyManagerConfig) -> AsyncIterator[None]:
    async with AsyncExitStack() as doors:
        for protocol in taken_part_in(config):
            door = listening(config.stack, protocol, KEY_LINK_PORTS[protocol])
            await doors.enter_async_context(door)
        yield


async def _keep(
    config: KeyManagerConfig, delivery: KeyDelivery, states: KeyLinkStates, link: KeyLink
) -> None:
    """Open sessions with one host, as its store needs them."""
    store, pause_s = delivery.stores[link.peer], link.pause_s
    filling = False
    while True:
        level = await asyncio.to_thread(lambda: min(store.mine, store.theirs))
        filling = level < (link.high if filling else link.low) or link.peer in delivery.withheld
        if not filling:
            await background_sleep(CHECK_PERIOD_S)
            continue
        port, options = KEY_LINK_PORTS[link.protocol], link.options
        outcome = await hold(config.stack, link.protocol, link.peer, port, options)
        states.ended(link.peer, outcome)
        note(delivery, link, outcome, config.time.stamp_ns())
        pause_s = min(2 * pause_s, FILLING_PAUSE_S) if outcome.fault else link.pause_s
        await asyncio.sleep(pause_s)


async def _take_part(
    config: KeyManagerConfig, delivery: KeyDelivery, states: KeyLinkStates, protocol: str
) -> None:
    links = {config.hosts[link.peer]: link for link in config.links if not link.opens}
    async for address, session in offered(config.stack, KEY_LINK_PORTS[protocol]):
        if address in links:
            session.add_done_callback(partial(_ended, config, delivery, states, links[address]))


def _ended(
    config: KeyManagerConfig,
    delivery: KeyDelivery,
    states: KeyLinkStates,
    link: KeyLink,
    session: asyncio.Task[Outcome],
) -> None:
    if not session.cancelled() and session.exception() is None:
        states.ended(link.peer, session.result())
        note(delivery, link, session.result(), config.time.stamp_ns())


def note(delivery: KeyDelivery, link: KeyLink, outcome: Outcome, stamp_ns: int) -> None:
    """Say what a session came to; too many errors close the way to the peer until one has few."""
    most = link.options.get("max_qber", KeyOptions.max_qber)
    alarmed = outcome.fault and outcome.qber is not None and outcome.qber > most
    if alarmed and delivery.withholds:
        delivery.withheld[link.peer] = f"the last session found a QBER of {outcome.qber:.4f}"
    elif not outcome.fault:
        delivery.withheld.pop(link.peer, None)
    store = delivery.stores[link.peer]
    fields = {
        "event": "session" if not outcome.fault else "alarm" if alarmed else "failed",
        "at": stamp_ns / 1e9,
        "peer": link.peer,
        "opened": link.opens,
        "keys": outcome.keys,
        "qber": outcome.qber,
        "mine": store.mine,
        "theirs": store.theirs,
        "withheld": link.peer in delivery.withheld,
        **({"text": outcome.fault} if outcome.fault else {}),
    }
    print(json.dumps(fields), flush=True)
