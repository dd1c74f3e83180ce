"""Sabot, the simulation manager: quantum states and what is done to them, no fibres."""
