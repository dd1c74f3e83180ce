"""The workers of a Dask cluster as machines of a network, and the hosts that are placed on them."""

import asyncio
import json
import logging
import os
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

import dask
from distributed import Client
from mininet.log import warn

from qmn.options import BadInput
from qmn.timeouts import AGENT_END_TIMEOUT_S, CLUSTER_TIMEOUT_S, WORKERS_TIMEOUT_S
from topologies.system.machines.agent import MODULE
from topologies.system.machines.gathering import gathered
from topologies.system.machines.machine import Machine
from topologies.system.namespaces import OWN_NAMESPACES
from topologies.system.processes.commands import WITH_THIS_PROCESS
from topologies.system.processes.programs import ROOT, NetworkError, python
from wire.parameters.checks import remedy

_agents: dict[str, subprocess.Popen[str]] = {}  # of this worker, by where their runner listens
FIRST = "m1"  # the machine of the runner
SCHEDULER = "scheduler-address"  # Dask's own setting: DASK_SCHEDULER_ADDRESS
LOG_LEVEL = 50  # critical: what concerns the user is raised


def begin_agent(name: str, runner: str, certificates: dict[str, str]) -> None:
    """Begin one; it ends with this worker at the latest, with all that it has started."""
    command = [str(OWN_NAMESPACES), "--network-of-machine", python(), "-P", "-m", MODULE]
    process = subprocess.Popen(
        [*WITH_THIS_PROCESS, *command, name, runner],
        stdin=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        text=True,
        start_new_session=True,
    )
    assert process.stdin is not None
    process.stdin.write(json.dumps(certificates))
    process.stdin.close()
    _agents[runner] = process


async def end_agent(runner: str) -> bool:
    """Wait until one has ended, as it does when its runner has gone; return whether it has.

    One that has not in time is killed, with all that it has started.
    """
    process = _agents.pop(runner, None)
    if process is None:
        return True
    try:
        await asyncio.to_thread(process.wait, AGENT_END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()  # or it would stay as a process that nobody asks how it ended
        return False
    return True


@contextmanager
def on_machines(
    count: int,
    placed: Sequence[str],
    scheduler: str,
    hosts: Sequence[str],
    folder: Path | None,
    check: Callable[[], None],
) -> Iterator[dict[str, Machine]]:
    """Give the machine of each host that is not on the first one, until this context ends.

    Raise BadInput for what cannot be, NetworkError for machines that are not there.
    """
    with connected(scheduler) as client:
        workers = found_workers(client, count - 1)
        addresses = {name: str(urlsplit(address).hostname) for name, address in workers.items()}
        where = places(placed, hosts, list(workers))
        used = {name: addresses[name] for name in sorted(set(where.values()))}
        begun: dict[str, str] = {}

        def begin(name: str, runner: str, certificates: dict[str, str]) -> None:
            client.run(begin_agent, name, runner, certificates, workers=[workers[name]])
            begun[name] = runner

        try:
            with gathered(used, begin, folder, check) as machines:
                yield {host: machines[name] for host, name in where.items()}
        finally:
            there = client.scheduler_info(n_workers=-1)["workers"]
            for name, runner in begun.items():
                if workers[name] not in there:
                    continue
                ended = client.run(end_agent, runner, workers=[workers[name]])
                if not all(ended.values()):
                    warn(f"{name}: its agent had not ended after {AGENT_END_TIMEOUT_S:g} s\n")


@contextmanager
def connected(scheduler: str) -> Iterator[Client]:
    """Connect to the scheduler that is named, or that Dask's own settings name."""
    address = scheduler or dask.config.get(SCHEDULER, "")
    if not address:
        raise BadInput(
            "several machines: name the Dask scheduler of their workers, as --scheduler "
            "tcp://192.0.2.1:8786, or in DASK_SCHEDULER_ADDRESS"
        )
    logging.getLogger("distributed").setLevel(LOG_LEVEL)
    try:
        client = Client(address, timeout=CLUSTER_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise NetworkError(
            f"no Dask scheduler answers at {address}: start `dask scheduler` there"
        ) from error
    with client:
        yield client


def found_workers(client: Client, least: int) -> dict[str, str]:
    """Return name and Dask address of the workers, as many as are wanted at least."""
    with suppress(TimeoutError):  # the error below names how many there are
        client.wait_for_workers(least, timeout=WORKERS_TIMEOUT_S)
    workers = client.scheduler_info(n_workers=-1)["workers"]
    named = {str(each["name"]): address for address, each in workers.items()}
    if len(named) < least:
        raise NetworkError(
            f"--machines {least + 1}: beside this machine there are {len(named)} workers "
            f"({', '.join(sorted(named)) or 'none'}): start `qmn worker` on others"
        )
    return {name: named[name] for name in sorted(named)}


def places(placed: Sequence[str], hosts: Sequence[str], workers: Sequence[str]) -> dict[str, str]:
    """Return the worker of each host that is not on the first machine; raise BadInput.

    Where none is placed, hosts go to the machines in turn, beginning with the first.
    """
    machines = [FIRST, *workers]
    if not placed:
        turns = {host: machines[turn % len(machines)] for turn, host in enumerate(hosts)}
        return {host: machine for host, machine in turns.items() if machine != FIRST}
    by_host = {}
    for text in placed:
        host, equals, machine = text.partition("=")
        if not equals or host in by_host:
            raise BadInput(f"--place {text}: write HOST=MACHINE, once a host")
        if host not in hosts:
            raise BadInput(f"--place {text}: no host {host}: {remedy(host, hosts)}")
        if machine not in machines:
            raise BadInput(f"--place {text}: no machine {machine}: {remedy(machine, machines)}")
        by_host[host] = machine
    return {host: machine for host, machine in by_host.items() if machine != FIRST}
