"""Records of what was asked of the dispatcher: for a replay, and as circuits in QASM."""
