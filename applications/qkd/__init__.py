"""Quantum key distribution: from raw outcomes at two ends to keys that both hold alike.

Pure thinking: no socket, clock or thread. `alice` and `bob` are the two ends as state
machines; every other module is one step of theirs.
"""
