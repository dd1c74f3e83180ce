"""How much light is asked for, what a known rotation does, how messages are cut."""

import numpy as np
import pytest

from applications.key_distribution.light import next_photons
from applications.key_distribution.under_way import PIECE_BYTES, Cutter, in_envelopes
from applications.measured_light import turned_back
from applications.qkd.messages import MAX_KEY_BITS, MAX_PHOTONS, MAX_PULSES, Disclosed, unsealed
from wire.malformed import MalformedPacket
from wire.outcomes import NO_COINCIDENCE, Pauli

MOST = 131_072


def test_the_first_block_is_for_what_is_wanted_or_as_large_as_it_may_be() -> None:
    assert 2000 < next_photons(1000, 0, 0, 0, MOST) < 2400
    assert next_photons(1_000_000, 0, 0, 0, MOST) == MOST


def test_later_blocks_are_for_what_is_missing_by_what_has_come_so_far() -> None:
    tenth = next_photons(1000, 500, 5000, 0, MOST)  # one photon of ten was of use
    assert 5000 < tenth < 5500
    assert next_photons(1000, 500, 5000, 2000, MOST) < tenth - 2000
    assert next_photons(1000, 500, 5000, 5000, MOST) == 0


def test_in_the_dark_blocks_grow() -> None:
    assert next_photons(1000, 0, 2000, 0, MOST) == MOST


def test_what_is_on_the_way_never_overflows_the_sifted_key() -> None:
    sifted = MAX_KEY_BITS - 60_000
    assert next_photons(MAX_KEY_BITS, sifted, sifted, 1000, MOST) == 59_000
    assert next_photons(MAX_KEY_BITS, sifted, sifted, 60_000, MOST) == 0


def test_blocks_of_much_loss_are_as_large_as_twice_the_share_allows() -> None:
    """Of 1,000 in a million so far, 2,000 at most: neither keys nor announcements grow longer."""
    most, sifted = MAX_PULSES, MAX_KEY_BITS - 100_000
    assert next_photons(1_000_000, 1000, 1_000_000, 0, most) == MAX_PHOTONS // 2 * 500
    assert next_photons(MAX_KEY_BITS, sifted, 1000 * sifted, 0, most) == 100_000 * 500


@pytest.mark.parametrize(
    ("rotation", "expected"),
    [
        (Pauli.I, [0, 1, 0, 1]),
        (Pauli.X, [1, 0, 0, 1]),
        (Pauli.Z, [0, 1, 1, 0]),
        (Pauli.XZ, [1, 0, 1, 0]),
    ],
)
def test_x_turns_outcomes_of_z_and_z_those_of_x(rotation: Pauli, expected: list[int]) -> None:
    bases = np.array([0, 0, 1, 1, 0], dtype=np.uint8)
    outcomes = np.array([0, 1, 0, 1, NO_COINCIDENCE], dtype=np.uint8)
    turned = turned_back(outcomes, bases, rotation)
    assert turned.tolist() == [*expected, NO_COINCIDENCE]


def test_messages_come_out_of_envelopes_as_they_went_in() -> None:
    messages = [
        unsealed(Disclosed(8 * size, bytes(size)), 1, number) + bytes(16)
        for number, size in enumerate((1, 3 * PIECE_BYTES, 0, 7))
    ]
    contents = b"".join(envelope.content for envelope in in_envelopes(1, messages))
    assert all(len(each.content) <= PIECE_BYTES for each in in_envelopes(1, messages))
    for step in (1, 1000, len(contents)):
        cutter = Cutter()
        pieces = [contents[start : start + step] for start in range(0, len(contents), step)]
        assert [each for piece in pieces for each in cutter.feed(piece)] == messages


def test_a_stream_that_is_no_message_is_refused_at_once() -> None:
    with pytest.raises(MalformedPacket, match="not key distribution"):
        list(Cutter().feed(b"HTTP"))
