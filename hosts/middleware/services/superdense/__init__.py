"""Superdense coding: bytes from one host to another, two bits a Bell pair."""
