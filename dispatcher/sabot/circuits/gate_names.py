"""The names of the gates in circuits, by kind."""

from dispatcher.sabot import gates

# The code of a backend's `pauli`; the phase of XZ against Y cannot be seen.
PAULIS = {"I": 0, "X": 1, "Z": 2, "Y": 3}
CLIFFORD = frozenset(gates.CLIFFORDS)
ROTATIONS = frozenset(gates.ROTATIONS)
