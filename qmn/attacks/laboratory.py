"""The attacks: what charlie does to alice, bob and the switches, and what comes of it.

Each is conducted against a network of its own, by a program that is root on charlie and sees what
a host sees; what it comes to is counted elsewhere.
"""

import re
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass

from qmn.timeouts import ATTACK_TIMEOUT_S, QUIET_S, TOLD_TIMEOUT_S
from topologies.network import Network
from topologies.programs import NetworkError, python
from topologies.timeouts import POLL_S
from wire.controller_record import read_record

FRAMES = [python(), "-m", "qmn.attacks.frames"]
ATTACKER, VICTIM, POSED = "charlie", "bob", "alice"
PINGS_A_SECOND = 10
DECIDED = ("granted", "refused", "forbidden")


@dataclass(frozen=True)
class Attack:
    """One attack; `conduct` returns the figure of one trial, with so many attempts."""

    counted: str  # what the figure is, of so many
    defence: str  # the switch of the policy's [filter]
    conduct: Callable[[Network, int], int]
    attempts: int


def arp_spoofing(network: Network, pings: int) -> int:
    """Tell bob that alice is at charlie; return how many of bob's pings to alice charlie gets."""
    attacker, victim, posed = (network.host(name) for name in (ATTACKER, VICTIM, POSED))
    victim.cmd(f"ping -c 1 -W 1 {posed.IP()}")  # so that there is something to be changed
    words = ["poison", str(attacker.defaultIntf()), victim.IP(), victim.MAC(), posed.IP()]
    with attacker.popen([*FRAMES, *words], text=True) as liar:
        try:
            wait_for_line(network, liar, "told")
            victim.cmd(f"ping -c {pings} -i {1 / PINGS_A_SECOND:g} -W 1 {posed.IP()}")
        finally:
            liar.terminate()
        said, errors = liar.communicate(timeout=ATTACK_TIMEOUT_S)
    return figure(said + errors)


def flow_table_flooding(network: Network, stations: int) -> int:
    """Speak as so many stations; return how many entries that has put into s1's tables."""
    meet(network)
    before = entries("s1")
    flood(network, "stations", stations)
    return settled(network, lambda: entries("s1")) - before


def set_up_flooding(network: Network, set_ups: int) -> int:
    """Ask for light on connections that nobody opened; return how often the controller decided."""
    meet(network)
    addresses = [network.host(name).IP() for name in (ATTACKER, VICTIM)]
    flood(network, "set-ups", set_ups, *addresses)
    return settled(network, lambda: len(decided(network)))


ATTACKS = {
    "arp-spoofing": Attack(
        "pings of bob to alice that reach charlie", "addresses", arp_spoofing, 20
    ),
    "flow-table-flooding": Attack(
        "made-up stations that take an entry of s1's table", "addresses", flow_table_flooding, 500
    ),
    "set-up-flooding": Attack(
        "set-ups without a connection that the controller decides",
        "handshakes",
        set_up_flooding,
        200,
    ),
}


def meet(network: Network) -> None:
    """Let s1 learn where charlie and bob are."""
    network.host(VICTIM).cmd(f"ping -c 1 -W 1 {network.host(ATTACKER).IP()}")


def flood(network: Network, what: str, count: int, *words: str) -> None:
    """Let charlie send so many frames, to bob."""
    attacker, victim = network.host(ATTACKER), network.host(VICTIM)
    command = [*FRAMES, what, str(attacker.defaultIntf()), str(count), victim.MAC(), *words]
    with attacker.popen(command, text=True) as sender:
        said, errors = sender.communicate(timeout=ATTACK_TIMEOUT_S)
    if figure(said + errors) != count:
        raise NetworkError(f"{ATTACKER} could not send {count} frames: {said}{errors}")


def wait_for_line(network: Network, program: "subprocess.Popen[str]", line: str) -> None:
    """Wait until a program has said a line; raise NetworkError if it will not."""
    deadline = time.monotonic() + TOLD_TIMEOUT_S
    assert program.stdout is not None
    while (said := program.stdout.readline()) and said.strip() != line:
        network.check()
        if time.monotonic() > deadline:
            break
    if said.strip() != line:
        raise NetworkError(f"{ATTACKER}'s program did not say {line!r} in {TOLD_TIMEOUT_S:g} s")


def figure(said: str) -> int:
    """Return the number that an attacker's program has printed; raise NetworkError if none."""
    found = re.search(r"figure=(\d+)", said)
    if found is None:
        raise NetworkError(f"{ATTACKER}'s program has failed: {said.strip()[-300:]}")
    return int(found[1])


def settled(network: Network, count: Callable[[], int]) -> int:
    """Return a count that has stayed what it is for a while."""
    last, since = count(), time.monotonic()
    deadline = since + ATTACK_TIMEOUT_S
    while time.monotonic() - since < QUIET_S and time.monotonic() < deadline:
        network.check()
        time.sleep(POLL_S)
        if (now := count()) != last:
            last, since = now, time.monotonic()
    return last


def entries(switch: str) -> int:
    """Return how many entries there are in the tables of a switch."""
    command = ["ovs-ofctl", "-O", "OpenFlow14", "dump-aggregate", switch]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, timeout=TOLD_TIMEOUT_S
    )
    found = re.search(r"flow_count=(\d+)", done.stdout)
    assert found, done.stdout
    return int(found[1])


def decided(network: Network) -> set[str]:
    """Return the sessions that the controller has decided on."""
    facts = read_record(network.runtime.logs)
    return {str(fact["session"]) for fact in facts if fact["event"] in DECIDED}
