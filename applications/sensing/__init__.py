"""Distributed sensing: the sum of phases at several hosts."""
