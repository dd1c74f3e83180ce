"""Position verification by entanglement (after Kent, Munro and Spiller, 2011, in the BB84 form).

    alice === bob --- charlie      alice and charlie verify where bob is

qmn cli sdc
qmn> charlie python docs/netqasm/position.py &
qmn> bob python docs/netqasm/position.py &
qmn> alice python docs/netqasm/position.py

Alice measures her halves of pairs along Z or X, by chance, and tells charlie in private; bob's
halves wait in his memory. Charlie tells bob the bases and takes the time until bob's outcomes are
back: a prover that answers as fast is as near, and another has to measure before the bases are
there. In the second round bob does that: one outcome in four is then wrong. The distance is a
bound: it counts the time of the software as well, which is most of it here.
"""

import json
import secrets
import socket
import time
from typing import Any, TextIO

from applications.qubits import Processor, Qubit

PAIRS, PORT, WAIT_S = 120, 5002, 60
ROUNDS = ("in place", "elsewhere")
KM_PER_S = 204_000  # of light in fibre


def bases() -> list[int]:
    """Return 0 for Z or 1 for X, by chance."""
    return [secrets.randbelow(2) for _ in range(PAIRS)]


def measured(processor: Processor, halves: list[Qubit], along: list[int]) -> list[int]:
    """Return what is found of each half along its basis."""
    for half, basis in zip(halves, along, strict=True):
        if basis:
            half.h()
    return processor.measure(halves)


def tell(other: TextIO, message: Any) -> None:
    """Send a line."""
    print(json.dumps(message), file=other, flush=True)


def hear(other: TextIO) -> Any:
    """Return the next line."""
    return json.loads(other.readline())


def called(processor: Processor, host: str) -> TextIO:
    """Return the way to a program that may not listen yet."""
    deadline = time.monotonic() + WAIT_S
    while True:
        try:
            address = processor.nodes[host], PORT
            return socket.create_connection(address, WAIT_S).makefile("rw")
        except ConnectionRefusedError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


def alice(processor: Processor) -> str:
    """Share pairs with bob, measure, and tell charlie what bob has to find."""
    charlie = called(processor, "charlie")
    for _round in ROUNDS:
        halves, along = processor.create_pairs("bob", PAIRS), bases()
        tell(charlie, (along, measured(processor, halves, along)))
        hear(charlie)  # the round is over
    return "has sent"


def bob(processor: Processor) -> str:
    """Answer charlie; in the second round with the outcomes found before he named the bases."""
    with socket.create_server((processor.nodes["bob"], PORT)) as door:
        door.settimeout(WAIT_S)
        charlie = door.accept()[0].makefile("rw")
        for place in ROUNDS:
            halves, early = processor.receive_pairs("alice", PAIRS), place == "elsewhere"
            found = measured(processor, halves, bases()) if early else []
            tell(charlie, "ready")
            along = hear(charlie)
            tell(charlie, found or measured(processor, halves, along))
    return "has answered"


def charlie(processor: Processor) -> str:
    """Ask bob, take the time, and compare."""
    rounds = []
    with socket.create_server((processor.nodes["charlie"], PORT)) as door:
        door.settimeout(WAIT_S)
        bob, alice = called(processor, "bob"), door.accept()[0].makefile("rw")
        for place in ROUNDS:
            along, expected = hear(alice)
            hear(bob)
            begun = time.monotonic()
            tell(bob, along)
            found = hear(bob)
            elapsed_s = time.monotonic() - begun
            wrong = sum(a != b for a, b in zip(expected, found, strict=True))
            km = elapsed_s / 2 * KM_PER_S
            rounds.append(
                f"{place}: {wrong} of {PAIRS} wrong, {1e3 * elapsed_s:.1f} ms, {km:.0f} km"
            )
            tell(alice, "over")
    return "; ".join(rounds)


ROLES = {"alice": alice, "bob": bob, "charlie": charlie}

if __name__ == "__main__":
    with Processor() as own:
        print(own.node, ROLES[own.node](own), flush=True)
