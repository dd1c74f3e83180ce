"""Dibits, Pauli operators and Bell states (paper, table "encoding").

A byte is four symbols, high bits first. An encoding is eight bits: symbol s is sent as
the Pauli operator (encoding >> 2s) & 3, agreed in the handshake. On Phi+ the operators
I, X, Z, XZ make the Bell states Phi+, Psi+, Phi-, Psi-, which carry the same two bits.
"""

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.qnic import NO_COINCIDENCE, Symbols

SYMBOLS_PER_BYTE = 4
_SHIFTS = np.array([6, 4, 2, 0], dtype=np.uint8)


def to_symbols(data: bytes) -> Symbols:
    """Return the symbols of data; shape (4 * len(data),)."""
    octets = np.frombuffer(data, dtype=np.uint8)
    symbols: Symbols = (octets[:, None] >> _SHIFTS & np.uint8(3)).reshape(-1)
    return symbols


def to_bytes(symbols: Symbols) -> bytes:
    """Return the bytes of symbols 0..3; the inverse of to_symbols."""
    octets: Symbols = np.bitwise_or.reduce(symbols.reshape(-1, SYMBOLS_PER_BYTE) << _SHIFTS, axis=1)
    return octets.tobytes()


def to_paulis(symbols: Symbols, encoding: int) -> Symbols:
    """Return the operator that sends each symbol."""
    return _operators(encoding)[symbols]


def from_bell_states(outcomes: Symbols, encoding: int, rotation: int) -> Symbols:
    """Return the symbol of each Bell outcome; 255 (no coincidence) stays 255.

    The known rotation of the light paths is a Pauli operator too: it is undone here.
    """
    symbol_of = np.full(256, NO_COINCIDENCE, dtype=np.uint8)
    symbol_of[_operators(encoding) ^ rotation] = np.arange(4, dtype=np.uint8)
    return symbol_of[outcomes]


def _operators(encoding: int) -> NDArray[np.uint8]:
    return np.array([encoding >> 2 * symbol & 3 for symbol in range(4)], dtype=np.uint8)
