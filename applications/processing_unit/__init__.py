"""The quantum network processing unit of a host: NetQASM on the host's own qubits."""
