"""Certificates of a run, and the private keys of whom they name."""
