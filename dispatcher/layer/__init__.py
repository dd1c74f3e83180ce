"""The physical layer as it is: network, ownership of qubits, pulses, memories, history."""
