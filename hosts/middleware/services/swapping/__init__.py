"""Entanglement swapping through chains of repeaters."""
