"""What kinds of gates there are in a circuit, by name."""

from dispatcher.sabot import gates

# The code of a backend's `pauli`; the phase of XZ against Y cannot be seen.
PAULIS = {"I": 0, "X": 1, "Z": 2, "Y": 3}
CLIFFORD = frozenset(gates.CLIFFORDS)
ROTATIONS = frozenset(gates.ROTATIONS)
