"""Quantum key distribution (BB84, BBM92) as sessions between two hosts."""
