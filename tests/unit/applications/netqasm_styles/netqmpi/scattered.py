"""The root scatters |1> and |0>; each rank flips its own; all are gathered, |1> of the root too."""

from typing import Any


def main(env: Any = None) -> None:
    comm, root = env.comm, 0
    with comm:
        if comm.rank == root:
            qubits = list(range(comm.size))  # one of each rank, in their order
            circuit = env.create_circuit(num_qubits=comm.size, num_clbits=comm.size)
            circuit.x(0)
            circuit.x(1)
            comm.qscatter(circuit, qubits[1:], root)
            comm.qgather(circuit, qubits, root)
            for qubit in qubits:
                circuit.measure(qubit, qubit)
        else:
            circuit = env.create_circuit(num_qubits=1, num_clbits=0)
            comm.qscatter(circuit, [0], root)
            circuit.x(0)
            comm.qgather(circuit, [0], root)
