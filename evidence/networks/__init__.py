"""Experiments in whole networks, one for each point: of sweeps, and demos of what emerges."""
