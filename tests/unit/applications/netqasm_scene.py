"""Programs of NetQASM applications in threads of this process, over stacks_scene's network."""

import asyncio
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import netqasm.examples.apps
from dispatcher_status import require_nothing_left
from limits import SOON_S
from stacks_scene import RELAYED, network

from applications.netqasm.external import installed
from applications.netqasm.placement import Placement
from applications.netqasm.program import begin, load
from applications.netqasm.round_end import RoundEnd
from hosts import network_loop

EXAMPLES = Path(netqasm.examples.apps.__file__).parent
Program = Callable[..., Any]
Output = TypeVar("Output")


def placed(folder: Path, hosts: Mapping[str, str]) -> Placement:
    """Return where roles are, all of them in this process."""
    return Placement(
        hosts,
        {role: RELAYED[host] for role, host in hosts.items()},
        {role: str(folder / f"{host}.sock") for role, host in hosts.items()},
    )


def outputs(
    folder: Path,
    programs: Mapping[str, Program] | Path,
    hosts: Mapping[str, str],
    inputs: Sequence[Mapping[str, Mapping[str, Any]]] = ({},),
    rounds: int = 1,
    **physics: Any,
) -> list[dict[str, Any]]:
    """Run the programs of all roles; return what each has returned, for each round.

    A path is the folder of an application; inputs are given one after the other, by role, each for
    a number of rounds. In the end no photon may be left.
    """

    def play(role: str, main: Program, end: RoundEnd) -> list[Any]:
        found = []
        for given in (given for given in inputs for _ in range(rounds)):
            try:
                found.append(begin(main, role, hosts[role], dict(given.get(role, {})), folder))
            finally:
                end.wait()
        return found

    def perform() -> list[dict[str, Any]]:
        with installed(placed(folder, hosts)) as ends, ThreadPoolExecutor(len(hosts)) as pool:
            entries = (
                {role: load(programs, role) for role in hosts}
                if isinstance(programs, Path)
                else programs
            )
            playing = {
                role: pool.submit(play, role, main, ends[role]) for role, main in entries.items()
            }
            reports = {role: each.result(2 * SOON_S) for role, each in playing.items()}
        return [
            dict(zip(reports, each, strict=True)) for each in zip(*reports.values(), strict=True)
        ]

    return performed(folder, perform, **physics)


def performed(folder: Path, perform: Callable[[], Output], **physics: Any) -> Output:
    """Return what programs of this process have done over the network. No photon may be left."""

    def alone() -> Output:
        forget_modules()
        output = perform()
        require_nothing_left(folder)
        return output

    async def run() -> Output:
        async with network(folder, **physics):
            return await asyncio.to_thread(alone)

    before = list(sys.path)
    try:
        return network_loop.run(run())
    finally:
        sys.path[:] = before


def forget_modules() -> None:
    """Forget what programs have imported from their own folders, and what keeps our sockets."""
    kept = "src", "shared", "netqmpi"
    for name in [name for name in sys.modules if name.split(".")[0] in kept]:
        del sys.modules[name]
