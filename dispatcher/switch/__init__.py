"""Quantum switches: their optics, what they are connected to over time, what is asked of them."""
