"""The conduct of attacks: charlie's programs, and what is seen of their effect."""

import re
import subprocess
import time
from collections.abc import Callable
from typing import Any

from qmn.timeouts import ATTACK_TIMEOUT_S, ATTACKER_TIMEOUT_S, QUIET_S
from topologies.networks.network import Network
from topologies.system.processes.programs import NetworkError, python
from topologies.timeouts import POLL_S
from wire.controller_lines import read_record

FRAMES = [python(), "-m", "evidence.attacks.frames"]
ATTACKER, VICTIM, POSED = "charlie", "bob", "alice"


def wait_for_line(network: Network, program: "subprocess.Popen[str]", line: str) -> None:
    """Wait until a program prints a line; raise NetworkError if it does not."""
    deadline = time.monotonic() + ATTACKER_TIMEOUT_S
    assert program.stdout is not None
    while (printed := program.stdout.readline()) and printed.strip() != line:
        network.check()
        if time.monotonic() > deadline:
            break
    if printed.strip() != line:
        raise NetworkError(f"{ATTACKER}'s program did not say {line!r} in {ATTACKER_TIMEOUT_S:g} s")


def sent_count(output: str) -> int:
    """Return the number that an attacker's program has printed; raise NetworkError if none."""
    match = re.search(r"count=(\d+)", output)
    if match is None:
        raise NetworkError(f"{ATTACKER}'s program has failed: {output.strip()[-300:]}")
    return int(match[1])


def settled(network: Network, count: Callable[[], int]) -> int:
    last, since = count(), time.monotonic()
    deadline = since + ATTACK_TIMEOUT_S
    while time.monotonic() - since < QUIET_S and time.monotonic() < deadline:
        network.check()
        time.sleep(POLL_S)
        if (now := count()) != last:
            last, since = now, time.monotonic()
    return last


def facts_of(network: Network, *events: str) -> list[dict[str, Any]]:
    return [fact for fact in read_record(network.runtime.logs) if fact["event"] in events]
