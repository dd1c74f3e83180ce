"""Quantum metadata: the classical messages that say how light will be used."""
