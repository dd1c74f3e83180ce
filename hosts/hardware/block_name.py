"""Blocks of a host by name."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BlockName:
    """k photons: half 0 or 1 of the pairs of one block of a session."""

    session: int
    number: int
    half: int
