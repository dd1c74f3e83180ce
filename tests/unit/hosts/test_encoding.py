"""The encoding table of the paper."""

import numpy as np
import pytest

from hosts.middleware.session.encoding import agreed_encoding, from_bell_states, to_paulis
from wire.metadata.vocabulary import PAPER_ENCODING
from wire.outcomes import Pauli

PHI_PLUS, PSI_PLUS, PHI_MINUS, PSI_MINUS = range(4)


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


@pytest.mark.parametrize("rotation", list(Pauli))
@pytest.mark.parametrize("proposed", [PAPER_ENCODING, 0b00_01_10_11])
def test_three_symbols_stay_apart_behind_every_rotation(proposed: int, rotation: Pauli) -> None:
    symbols = np.array([2, 0, 1, 1, 0], dtype=np.uint8)
    encoding = agreed_encoding(proposed, 3, rotation)
    bell_states = to_paulis(symbols, encoding) ^ np.uint8(rotation)
    seen = np.where(bell_states == PHI_MINUS, PHI_PLUS, bell_states)  # by linear optics
    assert from_bell_states(seen, encoding, rotation, 3).tolist() == symbols.tolist()


def test_the_encoding_of_three_symbols_must_follow_the_rotation() -> None:
    bell_states = to_paulis(np.arange(3, dtype=np.uint8), agreed_encoding(0, 3, Pauli.I)) ^ 1
    assert PHI_PLUS in bell_states
    assert PHI_MINUS in bell_states  # which linear optics cannot tell apart


@pytest.mark.parametrize("rotation", list(Pauli))
def test_an_encoding_of_four_symbols_is_the_proposed_one(rotation: Pauli) -> None:
    assert agreed_encoding(PAPER_ENCODING, 4, rotation) == PAPER_ENCODING
