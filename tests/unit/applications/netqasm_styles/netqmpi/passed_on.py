"""Two qubits, |1> and |+>, go from the first rank over all others to the last, which looks."""

from typing import Any


def main(env: Any = None) -> None:
    comm = env.comm
    with comm:
        circuit = env.create_circuit(num_qubits=2, num_clbits=2)
        if comm.rank == 0:
            circuit.x(0)
            circuit.h(1)
        else:
            comm.qrecv(circuit, [0, 1], comm.rank - 1)
        if comm.rank < comm.size - 1:
            comm.qsend(circuit, [0, 1], comm.rank + 1)
        else:
            circuit.h(1)
            circuit.measure(0, 0)
            circuit.measure(1, 1)
    if comm.rank == comm.size - 1:
        print("found", comm.results)
