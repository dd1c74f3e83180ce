"""GHZ states of three hosts, by fusion of pairs at bob: a protocol that is a program.

    alice === bob === charlie      pairs; bob's CNOT and measurement join two of them to one GHZ

qmn cli sdc
qmn> charlie python examples/ghz.py &
qmn> bob python examples/ghz.py &
qmn> alice python examples/ghz.py

Of every other state the three find the same along Z; along X, an even number of ones.
"""

import socket

from applications.qubits import Processor, Qubit

STATES, PORT = 12, 5000


def measured(processor: Processor, qubits: list[Qubit]) -> str:
    """Return what is found of each: along Z and along X in turns."""
    for qubit in qubits[1::2]:
        qubit.h()
    return "".join(map(str, processor.measure(qubits)))


def alice(processor: Processor) -> str:
    """Share pairs with bob."""
    return measured(processor, processor.create_pairs("bob", STATES))


def bob(processor: Processor) -> str:
    """Fuse pairs with alice and pairs with charlie; tell charlie what was found."""
    halves = processor.receive_pairs("alice", STATES)
    others = processor.create_pairs("charlie", STATES)
    for half, other in zip(halves, others, strict=True):
        half.cnot(other)
    with socket.create_connection((processor.nodes["charlie"], PORT), timeout=30) as charlie:
        charlie.sendall(bytes(processor.measure(others)))
    return measured(processor, halves)


def charlie(processor: Processor) -> str:
    """Share pairs with bob, and flip the halves of which bob has found a one."""
    with socket.create_server((processor.nodes["charlie"], PORT)) as listener:
        listener.settimeout(30)
        halves = processor.receive_pairs("bob", STATES)
        with listener.accept()[0] as connection:
            found = connection.recv(STATES, socket.MSG_WAITALL)
    for half, one in zip(halves, found, strict=True):
        if one:
            half.x()
    return measured(processor, halves)


ROLES = {"alice": alice, "bob": bob, "charlie": charlie}

if __name__ == "__main__":
    with Processor() as own:
        print(own.node, ROLES[own.node](own), flush=True)
