"""A CNOT between two hosts, at the price of a pair and two bits (Eisert et al. 2000).

    alice: control === pair === target :bob

qmn cli sdc
qmn> bob python docs/netqasm/teleported_cnot.py &
qmn> alice python docs/netqasm/teleported_cnot.py

Controls are 0, 1, + and + in turns, targets 0: both find 0, then 1, then by chance the same
along Z, and along X.
"""

import socket

from applications.qubits import Processor, Qubit

GATES, PORT = 40, 5002


def found_of(processor: Processor, qubits: list[Qubit]) -> list[int]:
    """Measure: every fourth along X."""
    for qubit in qubits[3::4]:
        qubit.h()
    return processor.measure(qubits)


def alice(processor: Processor) -> list[int]:
    """Bring bob's half to the value of each control, then undo what he has found of it."""
    controls = [processor.qubit() for _ in range(GATES)]
    for control in controls[1::4]:
        control.x()
    for control in controls[2::4] + controls[3::4]:
        control.h()
    halves = processor.create_pairs("bob", GATES)
    for control, half in zip(controls, halves, strict=True):
        control.cnot(half)
    found = bytes(processor.measure(halves))
    with socket.create_connection((processor.nodes["bob"], PORT), timeout=30) as bob:
        bob.sendall(found)
        phases = bob.recv(GATES, socket.MSG_WAITALL)
    for control, phase in zip(controls, phases, strict=True):
        if phase:
            control.z()
    return found_of(processor, controls)


def bob(processor: Processor) -> list[int]:
    """Flip each target by a half that has the value of alice's control; tell her its phase."""
    with socket.create_server((processor.nodes["bob"], PORT)) as listener:
        listener.settimeout(30)
        targets = [processor.qubit() for _ in range(GATES)]
        halves = processor.receive_pairs("alice", GATES)
        with listener.accept()[0] as alice:
            values = alice.recv(GATES, socket.MSG_WAITALL)
            for half, value, target in zip(halves, values, targets, strict=True):
                if value:
                    half.x()
                half.cnot(target)
                half.h()
            alice.sendall(bytes(processor.measure(halves)))
    return found_of(processor, targets)


ROLES = {"alice": alice, "bob": bob}

if __name__ == "__main__":
    with Processor() as own:
        print(own.node, "".join(map(str, ROLES[own.node](own))), flush=True)
