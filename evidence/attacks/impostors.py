"""Impostors on the management network: of switches towards c0, and of c0 towards switches.

There is no host. They are root's on this machine, in another namespace than c0's.
"""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from evidence.attacks.conduct import sent_count, wait_for_line
from qmn.timeouts import ATTACK_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.processes.commands import ip
from topologies.system.processes.programs import python

SPEAKERS = [python(), "-m", "evidence.attacks.speakers"]
SWITCH = "q1"


def impostor_switch(network: Network, switches: int) -> int:
    """Connect to c0 as switches that there are not; return how many of them it programs."""
    arguments_ = [*where(network), str(switches)]
    done = subprocess.run(
        [*SPEAKERS, "switch", *arguments_],
        capture_output=True,
        text=True,
        check=False,
        timeout=ATTACK_TIMEOUT_S,
    )
    return sent_count(done.stdout + done.stderr)


def impostor_controller(network: Network, orders: int) -> int:
    """Take c0's address towards q1, and give it orders; return how many of them it obeys."""
    host, port = where(network)
    command = [*SPEAKERS, "controller", host, port, str(orders)]
    with (
        taken(host),
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as impostor,
    ):
        try:
            wait_for_line(network, impostor, "listening")
            output, _ = impostor.communicate(timeout=ATTACK_TIMEOUT_S)
        finally:
            impostor.kill()
    return sent_count(output)


def where(network: Network) -> list[str]:
    """Return address and port at which q1 looks for c0."""
    (c0,) = network.net.controllers
    return [c0.addresses[SWITCH], str(c0.port)]


@contextmanager
def taken(address: str) -> Iterator[None]:
    ip([f"addr add {address}/32 dev lo"])
    try:
        yield
    finally:
        ip([f"addr del {address}/32 dev lo"])
