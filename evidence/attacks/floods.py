"""Attacks by many frames on switch and controller, and by lies about who has an address."""

import re
import time

from mininet.node import Host

from evidence.attacks.conduct import (
    ATTACKER,
    FRAMES,
    POSED,
    VICTIM,
    facts_of,
    sent_count,
    settled,
    wait_for_line,
)
from evidence.attacks.frames import station
from qmn.timeouts import ATTACK_TIMEOUT_S, ATTACKER_TIMEOUT_S, BELIEF_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.processes.commands import run
from topologies.system.processes.programs import NetworkError
from topologies.timeouts import POLL_S

PINGS_A_SECOND = 10
DISCARD = 9  # port of a service that does nothing (RFC 863)
DECIDED = ("granted", "refused", "forbidden")


def arp_spoofing(network: Network, pings: int) -> int:
    """Tell bob that alice is at charlie; return how many of bob's pings to alice charlie gets."""
    attacker, victim, posed = (network.host(name) for name in (ATTACKER, VICTIM, POSED))
    arguments = ["poison", str(attacker.defaultIntf()), victim.IP(), victim.MAC(), posed.IP()]
    with attacker.popen([*FRAMES, *arguments], text=True) as liar:
        try:
            wait_for_line(network, liar, "sent")
            # There is something to be changed then, and alice asks for bob only 5 s later: what he
            # hears of her is what he believes. It is no ping, which might be counted.
            victim.cmd(f"echo > /dev/udp/{posed.IP()}/{DISCARD}")
            wait_until_believed(network, victim, posed.IP(), attacker.MAC())
            victim.cmd(f"ping -c {pings} -i {1 / PINGS_A_SECOND:g} -W 1 {posed.IP()}")
        finally:
            liar.terminate()
        output, errors = liar.communicate(timeout=ATTACK_TIMEOUT_S)
    victim.cmd(f"ip neighbor flush to {posed.IP()}")  # or bob's replies would go on to charlie
    return sent_count(output + errors)


def wait_until_believed(network: Network, victim: Host, address: str, mac: str) -> None:
    """Wait until a host has a lie in its table; not for long, as there may be a defence."""
    deadline = time.monotonic() + BELIEF_TIMEOUT_S
    while mac not in victim.cmd(f"ip neighbor show {address}") and time.monotonic() < deadline:
        network.check()
        time.sleep(POLL_S)


def flow_table_flooding(network: Network, stations: int) -> int:
    """Send as `count` stations; return how many of them s1's tables have entries for."""
    meet(network)
    made_up = {station(number).hex(":") for number in range(stations)}
    flood(network, "stations", stations)
    return settled(network, lambda: len(made_up & senders("s1")))


def set_up_flooding(network: Network, set_ups: int) -> int:
    """Ask for light on connections that nobody opened; return how often the controller decided."""
    meet(network)
    addresses = [network.host(name).IP() for name in (ATTACKER, VICTIM)]
    flood(network, "set-ups", set_ups, *addresses)
    return settled(network, lambda: len(decided(network)))


def meet(network: Network) -> None:
    """Let s1 learn where charlie and bob are."""
    network.host(VICTIM).cmd(f"ping -c 1 -W 1 {network.host(ATTACKER).IP()}")


def flood(network: Network, what: str, count: int, *words: str) -> None:
    attacker, victim = network.host(ATTACKER), network.host(VICTIM)
    command = [*FRAMES, what, str(attacker.defaultIntf()), str(count), victim.MAC(), *words]
    with attacker.popen(command, text=True) as sender:
        output, errors = sender.communicate(timeout=ATTACK_TIMEOUT_S)
    if sent_count(output + errors) != count:
        raise NetworkError(f"{ATTACKER} could not send {count} frames: {output}{errors}")


def senders(switch: str) -> set[str]:
    flows = run("ovs-ofctl", "-O", "OpenFlow14", "dump-flows", switch, timeout_s=ATTACKER_TIMEOUT_S)
    return set(re.findall(r"dl_src=([0-9a-f:]+)", flows))


def decided(network: Network) -> set[str]:
    return {str(fact["session"]) for fact in facts_of(network, *DECIDED)}
