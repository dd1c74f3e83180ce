"""Attacks on an emulated network, each with its count, its defence off and on."""
