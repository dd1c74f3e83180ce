"""Alice's and bob's programs: CZ by a pair and two bits, for many pairs of qubits at a time."""

from typing import Any

from netqasm.sdk import EPRSocket, Qubit
from netqasm.sdk.external import NetQASMConnection, Socket

FLIPS = {"alice": ("X", "X", "", ""), "bob": ("X", "", "X", "")}  # around an oracle: 00, 01, 10, 11
BASES = {"alice": ("H", "", "ZSH"), "bob": ("", "H", "ZSH")}  # stabilisers of CZ |++>: XZ, ZX, YY


def main(app_config: Any, gates: int = 100) -> list[list[int]]:
    """Return what was found: in Grover's search by marked state, then of CZ |++> by basis."""
    role, logs = app_config.app_name, app_config.log_config
    other = "bob" if role == "alice" else "alice"
    pairs, link = EPRSocket(other), Socket(role, other, log_config=logs)
    unit = NetQASMConnection(role, log_config=logs, epr_sockets=[pairs], max_qubits=2 * gates)

    def cz(qubits: list[Qubit]) -> None:
        if role == "alice":
            halves = pairs.create_keep(number=gates)
            for qubit, half in zip(qubits, halves, strict=True):
                qubit.cnot(half)
            link.send("".join(map(str, measured(unit, halves))))
            for qubit in [q for q, bit in zip(qubits, link.recv(), strict=True) if bit == "1"]:
                qubit.Z()
            return
        halves = pairs.recv_keep(number=gates)
        unit.flush()
        for qubit, half, bit in zip(qubits, halves, link.recv(), strict=True):
            if bit == "1":
                half.X()
            half.cphase(qubit)
            half.H()
        link.send("".join(map(str, measured(unit, halves))))

    def done(steps: str) -> list[int]:
        qubits = [Qubit(unit) for _ in range(gates)]
        for step in steps:
            if step == "|":
                cz(qubits)
            else:
                for each in qubits:
                    getattr(each, step)()
        return measured(unit, qubits)

    with unit:
        searches = [done(f"H{flip}|{flip}HX|XH") for flip in FLIPS[role]]
        return searches + [done(f"H|{turned}") for turned in BASES[role]]


def measured(unit: NetQASMConnection, qubits: list[Qubit]) -> list[int]:
    outcomes = [qubit.measure() for qubit in qubits]
    unit.flush()
    return [int(outcome) for outcome in outcomes]
