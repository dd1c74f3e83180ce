"""What the dispatcher does to qubits, written down as a circuit in OpenQASM 2.0."""
