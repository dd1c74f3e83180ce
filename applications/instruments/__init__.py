"""Optical switches that laboratories own, driven by the agents of quantum switches."""
