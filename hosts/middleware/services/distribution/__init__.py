"""Entanglement distribution: pairs in the memories of two hosts, purified as asked."""
