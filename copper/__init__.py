"""The copper of a network: delay, rate and loss of its cables."""
