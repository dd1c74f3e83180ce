"""Applications that know nothing of qubits."""
