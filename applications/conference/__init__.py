"""Conference key agreement: one key of all hosts of a line, by GHZ states."""
