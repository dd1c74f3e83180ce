"""What the runner has Dask workers do: begin and end its agents on their machines."""

import asyncio
import json
import os
import subprocess

from qmn.timeouts import AGENT_END_TIMEOUT_S
from topologies.apart import OWN_NAMESPACES
from topologies.machines.agent import MODULE
from topologies.programs import ROOT, python

_agents: dict[str, subprocess.Popen[str]] = {}  # of this worker, by where their runner listens


def begin_agent(name: str, runner: str, certificates: dict[str, str]) -> None:
    """Begin one; it ends with this worker at the latest, with all that it has started."""
    command = [str(OWN_NAMESPACES), "--network-of-machine", python(), "-P", "-m", MODULE]
    process = subprocess.Popen(
        ["setpriv", "--pdeathsig", "KILL", *command, name, runner],
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
    """Wait until one has ended, as it does when its runner has gone; return whether it has."""
    process = _agents.pop(runner, None)
    if process is None:
        return True
    try:
        await asyncio.to_thread(process.wait, AGENT_END_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return False
    return True
