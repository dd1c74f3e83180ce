"""What kinds of gates there are in a circuit, by name."""

# The code of a backend's `pauli`; the phase of XZ against Y cannot be seen.
PAULIS = {"I": 0, "X": 1, "Z": 2, "Y": 3}
CLIFFORD = frozenset(("H", "S", "S_DAG", "CX", "CZ"))
ROTATIONS = frozenset(("RX", "RY", "RZ"))
