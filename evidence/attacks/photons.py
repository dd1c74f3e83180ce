"""Attacks on light: what eve knows of a sifted key, and what the ends' post-processing leaves her.

    alice === eve === bob

Without defence the sifted bits are the key. With it the ends make a shorter key of them, by the
bounds that qmn run qkd uses: what amplification takes away is first of all what eve knows (a key
of L bits from N, of which she knows K, leaves her nothing as long as K + L <= N).
"""

import asyncio
from typing import Any, NamedTuple

import numpy as np

from applications.interception.photons import LEFT_ALONE
from applications.qkd.key_length import asymptotic_fraction
from evidence.curves.bb84 import TO_BOB, TO_EVE, X, decoy_key, decoys_of, spied
from evidence.curves.link import fiber, network
from evidence.curves.parameters import Point

SEED = 1
TAPPED = 0.2  # of the photons, by a tap
HIDDEN_DB = 8.0  # of loss that eve stands in for, when she splits
PULSES_PER_BIT = 10  # of which a weak laser's are sifted by then, and more


class Spied(NamedTuple):
    bits: int
    known: int  # to eve
    wrong: int

    @property
    def qber(self) -> float:
        """The share of the bits that differ."""
        return self.wrong / self.bits

    def left(self, length: float) -> int:
        """Return how many bits eve knows of a key of this length made of it."""
        return max(0, self.known - round(self.bits - length))


def intercept_resend(defended: bool, bits: int) -> tuple[int, int]:
    """Measure every photon in Z or X, and send on what is found; return bits known, of how many."""
    return resent(defended, bits, 1.0)


def fiber_tap(defended: bool, bits: int) -> tuple[int, int]:
    return resent(defended, bits, TAPPED)


def resent(defended: bool, bits: int, fraction: float) -> tuple[int, int]:
    """Return how many bits eve knows who has measured a fraction of the photons, of how many."""
    sifted = asyncio.run(_resent(2 * bits, fraction))
    share = asymptotic_fraction(sifted.qber) if defended else 1.0
    return sifted.left(share * sifted.bits), sifted.bits


async def _resent(photons: int, fraction: float) -> Spied:
    laboratory = network(SEED, [fiber(*TO_EVE), fiber(*TO_BOB)])
    alice, eve, bob = (laboratory.host(name) for name in ("alice", "eve", "bob"))
    random, light = np.random.default_rng(SEED), (0, 0)
    states = random.integers(0, 4, photons, dtype=np.uint8)
    bases, hers = random.integers(0, 2, (2, photons), dtype=np.uint8)
    taken = random.random(photons) < fraction
    await alice.prepare(states, light[0])
    await alice.send({light: TO_EVE[0]})
    await eve.receive(light, TO_EVE[1])
    seen: Any = await eve.resend(light, np.where(taken, hers, LEFT_ALONE).astype(np.uint8))
    await eve.send({light: TO_BOB[0]})
    await bob.receive(light, TO_BOB[1])
    outcomes: Any = await bob.measure(light, bases=bases)
    sifted = bases == states >> 1
    right = states & 1
    knows = sifted & taken & (hers == bases) & (seen == right)
    wrong = sifted & (outcomes != right)
    return Spied(int(sifted.sum()), int(knows.sum()), int(wrong.sum()))


def photon_splitting(defended: bool, bits: int) -> tuple[int, int]:
    """Keep a photon of each pulse of several; return bits known, of how many.

    The defence is decoy states, by which the ends find how much light of single photons comes.
    """
    decoys, pulses = "on" if defended else "off", PULSES_PER_BIT * 2 * bits
    point = Point(loss_db=HIDDEN_DB, mean_photons=0.5, eve="on", decoys=decoys, pairs=pulses)
    exchange, known_bits = asyncio.run(spied(point, SEED))
    of_key, sent = exchange.counts[X], int(exchange.sent.sum())
    sifted = Spied(int(of_key.sum()), int(known_bits[X]), int(of_key[1].sum()))
    length = float(sifted.bits)
    if defended:
        length = decoy_key(decoys_of(point), exchange.counts, sent).value * sent
    return sifted.left(length), sifted.bits
