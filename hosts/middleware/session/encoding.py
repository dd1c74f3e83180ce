"""Symbols, Pauli operators and Bell states (paper, table "encoding").

An encoding is eight bits: symbol s is sent as the Pauli operator (encoding >> 2s) & 3,
agreed in the handshake. On Phi+ the operators I, X, Z, XZ make the Bell states Phi+, Psi+,
Phi-, Psi-, numbered like the operators. A known rotation of the light paths is a Pauli
operator too: number of the state that arrives = operator ^ rotation.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hosts.hardware.replies import Symbols
from wire.outcomes import NO_COINCIDENCE, Pauli

DISTINGUISHABLE_STATES = {
    "complete": 4,
    "linear": 3,
    "gates": 4,
    "beam-splitter": 2,
}  # Bell states, by the kind of the analyser
# Linear optics reports Phi- as Phi+, so Phi- carries nothing (its symbol, 3, is never sent).
LINEAR_STATES = (Pauli.I, Pauli.X, Pauli.XZ, Pauli.Z)


def agreed_encoding(proposed: int, symbols: int, rotation: int) -> int:
    """Return by which operators the sender shall send its symbols.

    Four states: as it proposes, for the receiver can undo any rotation. Three: those that
    make Phi+, Psi+ and Psi- behind the rotation, since the receiver could not tell others.
    """
    if symbols == len(LINEAR_STATES):
        return proposed
    return sum((state ^ rotation) << 2 * symbol for symbol, state in enumerate(LINEAR_STATES))


def to_paulis(symbols: Symbols, encoding: int) -> Symbols:
    return _translated(symbols, _sending(encoding))


def from_bell_states(outcomes: Symbols, encoding: int, rotation: int, symbols: int = 4) -> Symbols:
    """Return the symbol of each Bell outcome; 255 (no coincidence) stays 255.

    The known rotation of the light paths is undone here.
    """
    return _translated(outcomes, _reading(encoding, rotation, symbols))


def _translated(values: Symbols, table: bytes) -> Symbols:
    """Look bytes up in a table of 256: numpy's indexing takes twice as long."""
    return np.frombuffer(values.tobytes().translate(table), dtype=np.uint8)


@lru_cache(maxsize=64)
def _sending(encoding: int) -> bytes:
    return _operators(encoding).tobytes().ljust(256, b"\0")


@lru_cache(maxsize=64)
def _reading(encoding: int, rotation: int, symbols: int) -> bytes:
    symbol_of = np.full(256, NO_COINCIDENCE, dtype=np.uint8)
    states = _operators(encoding)[:symbols] ^ rotation
    symbol_of[states] = np.arange(symbols, dtype=np.uint8)
    return symbol_of.tobytes()


def _operators(encoding: int) -> NDArray[np.uint8]:
    return np.array([encoding >> 2 * symbol & 3 for symbol in range(4)], dtype=np.uint8)
