"""The requests for light that a controller takes, by the processor time of it alone.

Its switches and hosts are played (evidence/bench/played_switches.py): they answer at once. Eight
ask at a time. Each request is a TCP connection of its own, which is opened, asks, and is closed.
"""

import asyncio
import secrets
import time
from collections.abc import Coroutine, Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import count, cycle, islice
from pathlib import Path
from typing import Any

from evidence.bench.played_switches import Q1, Host, PlayedNetwork
from qmn.timeouts import BASELINE_READY_TIMEOUT_S, MEASURE_TIMEOUT_S
from topologies.networks.discovery import found
from topologies.networks.network import Signals
from topologies.system.processes.programs import NetworkError, Program, python
from topologies.system.runs.runtime import free_port
from topologies.timeouts import POLL_S
from wire.config import ControllerConfig
from wire.controller_lines import NewFacts
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Verdict

AT_ONCE = 8
REQUESTS = 2000
KEY_BYTES = 32


@dataclass(frozen=True)
class Load:
    """A number of requests, and their cost."""

    requests: int
    processor_s: float  # of the controller
    elapsed_s: float

    def __str__(self) -> str:
        return (
            f"{1e3 * self.processor_s / self.requests:.2f} ms of a processor each: one is full at "
            f"{self.requests / self.processor_s:,.0f}/s ({self.requests / self.elapsed_s:,.0f}/s "
            f"by the clock)"
        )


def controller_benchmarks(
    folder: Path, signals: Signals, framework: str = "ryu", requests: int = REQUESTS
) -> Iterator[tuple[str, str]]:
    """Yield name and text of both; raise NetworkError if the controller fails."""
    folder.mkdir()
    keys = [secrets.token_hex(KEY_BYTES) for _ in range(2 * AT_ONCE)]
    hosts = [Host(number, key) for number, key in enumerate(keys, 1)]
    port = free_port()
    config = ControllerConfig(
        f"127.0.0.1:{port}",
        framework,
        {"q1": Q1},
        record=str(folder / "controller.jsonl"),
        device_keys={host.name: host.key for host in hosts},
        addresses={host.name: host.address for host in hosts},
        stations=[host.station for host in hosts],
    )
    config.write(folder / "c0.json")
    controller = Program("c0", folder / "c0.log")
    command = [python(), "-m", "controller_apps", "--config", str(folder / "c0.json")]
    controller.start(command)
    try:
        controller.wait_for("ready", BASELINE_READY_TIMEOUT_S, signals.check)
        granted, refused = asyncio.run(
            loads(PlayedNetwork(hosts), folder, port, requests, controller, signals)
        )
    except (OSError, ValueError, TimeoutError) as error:
        raise NetworkError(
            f"the controller was not measured: {error!r}; its log: {controller.log}"
        ) from error
    finally:
        controller.stop()
    yield f"{framework}, light granted", str(granted)
    yield f"{framework}, light refused as BUSY", str(refused)


async def loads(
    network: PlayedNetwork,
    folder: Path,
    port: int,
    requests: int,
    controller: Program,
    signals: Signals,
) -> tuple[Load, Load]:
    """Return what requests took that were granted, and those that were refused."""
    switches = network.s1, network.q1
    serving = []
    try:
        for switch in switches:
            await switch.connect("127.0.0.1", port)
            serving.append(asyncio.create_task(switch.serve()))
        measuring = asyncio.create_task(both(network, folder, requests, controller, signals))
        done, _ = await asyncio.wait([*serving, measuring], return_when=asyncio.FIRST_COMPLETED)
        for ended in done:
            ended.result()
        return measuring.result()
    finally:
        for task in serving:
            task.cancel()
        for switch in switches:
            switch.close()


async def both(
    network: PlayedNetwork, folder: Path, requests: int, controller: Program, signals: Signals
) -> tuple[Load, Load]:
    """Measure `count` requests that are granted, then as many that are refused."""
    await all_known(network, folder, signals)
    each = requests // AT_ONCE
    places = count(1)
    pairs = list(zip(network.hosts[::2], network.hosts[1::2], strict=True))

    async def granted(opener: Host, acceptor: Host) -> None:
        for place in islice(places, each):
            signals.check()
            setup = await network.ask(opener, acceptor, place)
            require(setup, Verdict.GRANTED, Reason.OK)
            await network.give_back(setup.session)

    async def refused(opener: Host) -> None:
        for place in islice(places, each):
            signals.check()
            setup = await network.ask(opener, busy, place)
            require(setup, Verdict.REFUSED, Reason.BUSY)
            network.close(setup.session)

    taken = await measured(controller, requests, [granted(*pair) for pair in pairs])
    holder, busy = pairs[0]
    await network.ask(holder, busy, next(places))
    openers = islice(cycle([opener for opener, _ in pairs[1:]]), AT_ONCE)
    return taken, await measured(controller, requests, [refused(opener) for opener in openers])


def require(setup: Setup, verdict: Verdict, reason: Reason) -> None:
    """Raise ValueError for another verdict, or another reason."""
    if (setup.verdict, setup.reason) != (verdict, reason):
        outcome = f"{Verdict(setup.verdict).name} ({Reason(setup.reason).name})"
        raise ValueError(f"session {setup.session:016x} is {outcome}, not {verdict.name}")


async def measured(
    controller: Program, requests: int, askers: list[Coroutine[Any, Any, None]]
) -> Load:
    before, began = controller.processor_s, time.monotonic()
    await asyncio.wait_for(asyncio.gather(*askers), MEASURE_TIMEOUT_S)
    return Load(requests, controller.processor_s - before, time.monotonic() - began)


async def all_known(network: PlayedNetwork, folder: Path, signals: Signals) -> None:
    """Announce fibres until the controller has found them and both switches."""
    deadline = time.monotonic() + BASELINE_READY_TIMEOUT_S
    unknown = {f"switch {switch.dpid:#x}" for switch in (network.s1, network.q1)}
    unknown |= {host.fiber for host in network.hosts}
    with closing(NewFacts(folder)) as facts:
        while unknown := unknown - found(facts.read()):
            signals.check()
            if time.monotonic() > deadline:
                missing = ", ".join(sorted(unknown))
                raise ValueError(f"{missing} not found in {BASELINE_READY_TIMEOUT_S:g} s")
            network.announce()
            await asyncio.sleep(POLL_S)
