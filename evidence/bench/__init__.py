"""Measurements of this machine and of the product on it, for qmn lab bench."""
