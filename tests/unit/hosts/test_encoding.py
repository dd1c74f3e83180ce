"""The encoding table of the paper."""

import numpy as np
import pytest

from hosts.middleware.encoding import from_bell_states, to_bytes, to_paulis, to_symbols
from wire.metadata import PAPER_ENCODING, Pauli

PHI_PLUS, PSI_PLUS, PHI_MINUS, PSI_MINUS = range(4)


def test_a_byte_is_four_symbols_high_bits_first() -> None:
    assert to_symbols(b"\x1b").tolist() == [0b00, 0b01, 0b10, 0b11]


def test_every_byte_survives() -> None:
    data = bytes(range(256))
    assert to_bytes(to_symbols(data)) == data
    assert to_bytes(to_symbols(b"")) == b""


def test_the_paper_s_table() -> None:
    symbols = np.array([0b00, 0b01, 0b10, 0b11], dtype=np.uint8)
    assert to_paulis(symbols, PAPER_ENCODING).tolist() == [Pauli.I, Pauli.X, Pauli.Z, Pauli.XZ]
    states = np.array([PHI_PLUS, PSI_PLUS, PHI_MINUS, PSI_MINUS], dtype=np.uint8)
    assert from_bell_states(states, PAPER_ENCODING, Pauli.I).tolist() == symbols.tolist()


@pytest.mark.parametrize("encoding", [PAPER_ENCODING, 0b00_01_10_11, 0b10_00_11_01])
@pytest.mark.parametrize("rotation", list(Pauli))
def test_any_agreed_encoding_and_known_rotation_is_undone(encoding: int, rotation: Pauli) -> None:
    symbols = np.array([3, 0, 2, 1, 1], dtype=np.uint8)
    bell_states = to_paulis(symbols, encoding) ^ np.uint8(rotation)
    assert from_bell_states(bell_states, encoding, rotation).tolist() == symbols.tolist()


def test_no_coincidence_stays_no_coincidence() -> None:
    outcomes = np.array([255, 0], dtype=np.uint8)
    assert from_bell_states(outcomes, PAPER_ENCODING, Pauli.Z).tolist() == [255, 2]
