"""Teleportation of single-qubit states."""
