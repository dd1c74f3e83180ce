"""Light of key distribution: photons sent, or measured as they arrive, and how many to ask for."""

from math import ceil

import numpy as np

from applications.measured_light import turned_back
from applications.qkd.bell_test import BellOutcomes
from applications.qkd.decoy import SHARES
from applications.qkd.messages import MAX_KEY_BITS, MAX_PHOTONS
from applications.qkd.sifting import Clicks, Prepared, Record
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Symbols
from hosts.middleware.session.protocol import (
    Collect,
    Emit,
    Light,
    OpenerSide,
    Side,
    Steps,
    begin,
    do,
    require_size,
)
from hosts.timeouts import KEY_GRACE_S, LIGHT_TIMEOUT_S
from wire.keyed import KEY_BYTES, KeyedChoices
from wire.outcomes import NO_COINCIDENCE, PAULI_BASES

EVEN_CHANCE = 0.5  # that two random bases agree
MARGIN, MARGIN_PHOTONS = 1.05, 64
MOST_SHARE = 2  # times the share of photons sifted so far: of the next ones, at most


def with_tests(random: np.random.Generator, bases: Symbols, fraction: float) -> Symbols:
    """Return the bases, of which a fraction are those of the CHSH test instead: Z+X or Z-X."""
    if not fraction:
        return bases
    settings = random.integers(0, 2, bases.size, dtype=np.uint8) + np.uint8(PAULI_BASES)
    return np.where(random.random(bases.size) < fraction, settings, bases).astype(np.uint8)


def record_of(outcomes: Symbols, bases: Symbols, rotation: int) -> Record:
    """Return what was measured, as without a known Pauli operator on the way; tests for CHSH apart.

    That turns Z+X into Z-X and back, but for the sign, if it is X or Z alone.
    """
    halfway = bases >= PAULI_BASES
    tested = halfway & (outcomes != NO_COINCIDENCE)
    swapped, flipped = (rotation ^ rotation >> 1) & 1, rotation & 1
    settings = (bases[tested] - np.uint8(PAULI_BASES)) ^ np.uint8(swapped)
    bell = BellOutcomes(tested, settings, outcomes[tested] ^ np.uint8(flipped))
    chosen = np.where(halfway, 0, bases).astype(np.uint8)
    rest = np.where(halfway, NO_COINCIDENCE, turned_back(outcomes, chosen, rotation))
    return Record(chosen, rest.astype(np.uint8), tests=bell)


def next_photons(count: int, sifted: int, seen: int, on_the_way: int, most: int) -> int:
    """Return how many photons to send for `count` sifted bits; 0 if enough may be on the way.

    The `seen` photons have given `sifted` bits so far.
    """
    share = max(sifted, EVEN_CHANCE) / seen if seen else EVEN_CHANCE
    missing = count - sifted - share * on_the_way
    if missing <= 0:
        return 0
    needed = ceil(MARGIN * missing / share) + MARGIN_PHOTONS
    likely = min(1.0, MOST_SHARE * share) if seen else 1.0
    room = int((MAX_KEY_BITS - sifted) / likely) - on_the_way
    return max(0, min(needed, most, room, int(MAX_PHOTONS * EVEN_CHANCE / likely)))


def detecting(side: Side, name: BlockName, key: bytes) -> Steps[Light]:
    """Begin to measure what arrives, in bases that a key chooses."""
    return begin(Qnic.click_arrivals, name, side.ports[0], key, LIGHT_TIMEOUT_S)


def detected(side: Side, light: Light, bases: KeyedChoices, rotation: int = 0) -> Steps[Clicks]:
    """Return what was found of light that is over, as without a known Pauli operator on the way."""
    photons = bases.count
    clicks = yield Collect(light, KEY_GRACE_S + photons / side.setup.rate_hz)
    if clicks is None:
        none = np.zeros(0, np.int64)
        return Clicks(photons, none, Record(none.astype(np.uint8), none.astype(np.uint8)))
    require_size(clicks.photons, photons)
    chosen = bases.bases(clicks.at)
    return Clicks(photons, clicks.at, Record(chosen, turned_back(clicks.bits, chosen, rotation)))


def prepare_and_send(
    side: OpenerSide, number: int, photons: int, *, with_decoys: bool
) -> Steps[Prepared]:
    """Send a block of random states; return how they were chosen when it has left."""
    setup, shares = side.setup, SHARES if with_decoys else ()
    choices = KeyedChoices(side.draws.bytes(KEY_BYTES), photons, shares)
    block = yield from do(Qnic.prepare_by_key, setup.session, number, choices)
    yield from do(Qnic.send, block, side.ports[0], setup.rate_hz, setup.wavelength_pm)
    return Prepared(choices)


def measure_halves(side: OpenerSide, number: int, pairs: int) -> Steps[Clicks]:
    """Have the source make a block of pairs; return what was measured of half 0."""
    bases = KeyedChoices(side.draws.bytes(KEY_BYTES), pairs)
    light = yield from detecting(side, side.block(number), bases.key)
    yield Emit(number, pairs)
    return (yield from detected(side, light, bases))
