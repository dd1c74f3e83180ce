"""Noise of fibres: one small class for each kind."""
