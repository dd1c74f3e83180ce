"""Attacks on an emulated network, each with its figure, its defence off and on."""
