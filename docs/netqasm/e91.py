"""Ekert's key distribution (1991): a key, and a Bell test that tells whether somebody listens.

    alice === bob      pairs Phi+; each half is measured along one of three axes, by chance

qmn cli sdc
qmn> bob python docs/netqasm/e91.py &
qmn> alice python docs/netqasm/e91.py

Where both have chosen the same axis the bits are key. The others give S of CHSH: 2 sqrt 2 of
perfect pairs, less over noise, and no more than 2 if every half was measured on its way.
"""

import json
import secrets
import socket
from collections import defaultdict
from collections.abc import Callable
from statistics import mean
from typing import Any

from applications.qubits import Processor, Qubit

ROUNDS, PAIRS, PORT = 8, 240, 5001
AXES = {"alice": (0, 1, 2), "bob": (1, 2, 3)}  # from Z towards X, in eighths of a turn
# Signs of correlations in S, by alice's axis and bob's.
SIGNS: dict[tuple[int, ...], int] = {(0, 1): 1, (0, 3): -1, (2, 1): 1, (2, 3): 1}

Found = list[tuple[int, int]]  # axis and outcome of each pair


def measured(processor: Processor, share: Callable[[], list[Qubit]]) -> Found:
    """Share pairs, and measure each half along an axis by chance."""
    found: Found = []
    for _ in range(ROUNDS):
        halves = share()
        axes = [secrets.choice(AXES[processor.node]) for _ in halves]
        for half, axis in zip(halves, axes, strict=True):
            half.rotate("y", -axis % 8, 2)  # brings the axis to Z
        found += zip(axes, processor.measure(halves), strict=True)
    return found


def alice(processor: Processor) -> str:
    """Have pairs made, and compare."""
    found = measured(processor, lambda: processor.create_pairs("bob", PAIRS))
    with socket.create_connection((processor.nodes["bob"], PORT), timeout=30) as bob:
        return compared(found, bob, SIGNS)


def bob(processor: Processor) -> str:
    """Receive halves, and compare."""
    with socket.create_server((processor.nodes["bob"], PORT)) as listener:
        listener.settimeout(30)
        found = measured(processor, lambda: processor.receive_pairs("alice", PAIRS))
        with listener.accept()[0] as alice:
            return compared(found, alice, {axes[::-1]: sign for axes, sign in SIGNS.items()})


def compared(found: Found, other: socket.socket, signs: dict[tuple[int, ...], int]) -> str:
    """Return S and the key; all axes are public, and outcomes along axes that differ."""
    with other.makefile() as lines:

        def exchanged(mine: list[Any]) -> list[Any]:
            other.sendall(f"{json.dumps(mine)}\n".encode())
            theirs: list[Any] = json.loads(lines.readline())
            return theirs

        both = list(zip(found, exchanged([axis for axis, _ in found]), strict=True))
        public = exchanged([outcome if axis != their else None for (axis, outcome), their in both])
    key = ""
    alike: dict[tuple[int, ...], list[bool]] = defaultdict(list)
    for ((axis, outcome), their_axis), theirs in zip(both, public, strict=True):
        if axis == their_axis:
            key += str(outcome)
        else:
            alike[axis, int(their_axis)].append(outcome == theirs)
    s = sum(sign * (2 * mean(alike[axes]) - 1) for axes, sign in signs.items())
    return f"S {s:.3f} key {key}"


ROLES = {"alice": alice, "bob": bob}

if __name__ == "__main__":
    with Processor() as own:
        print(own.node, ROLES[own.node](own), flush=True)
