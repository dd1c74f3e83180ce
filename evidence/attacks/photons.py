"""Attacks on light: what eve knows of a sifted key, and what the ends' post-processing leaves her.

    alice === eve === bob

Without defence the sifted bits are the key. With it the ends make a shorter key of them, by the
bounds that qmn run qkd uses: what amplification takes away is first of all what eve knows (a key
of L bits from N, of which she knows K, leaves her nothing as long as K + L <= N).
"""

import asyncio
from typing import Any, NamedTuple

import numpy as np

from dispatcher.laboratory import Laboratory
from evidence.curves import photon_splitting as splitting
from evidence.curves.decoy_states import X, key
from evidence.curves.link import configuration, fiber
from evidence.curves.multi_pair import LOSS
from evidence.curves.parameters import Values
from evidence.curves.photon_splitting import TO_BOB, TO_EVE
from hosts.hardware.qnic import LEFT_ALONE
from hosts.middleware.qkd.decoy import Decoys
from hosts.middleware.qkd.key_length import asymptotic_fraction

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
    spied = asyncio.run(_resent(2 * bits, fraction))
    share = asymptotic_fraction(spied.qber) if defended else 1.0
    return spied.left(share * spied.bits), spied.bits


async def _resent(photons: int, fraction: float) -> Spied:
    laboratory = Laboratory(configuration(SEED, [fiber(*TO_EVE), fiber(*TO_BOB)]))
    alice, eve, bob = (laboratory.host(name) for name in ("alice", "eve", "bob"))
    random, light = np.random.default_rng(SEED), (0, 0)
    states = random.integers(0, 4, photons, dtype=np.uint8)
    bases, hers = random.integers(0, 2, (2, photons), dtype=np.uint8)
    taken = random.random(photons) < fraction
    await alice.prepare(states, light[0])
    await alice.send({light: TO_EVE[0]})
    await eve.receive(light, TO_EVE[1])
    found: Any = await eve.resend(light, np.where(taken, hers, LEFT_ALONE).astype(np.uint8))
    await eve.send({light: TO_BOB[0]})
    await bob.receive(light, TO_BOB[1])
    outcomes: Any = await bob.measure(light, bases=bases)
    sifted = bases == states >> 1
    right = states & 1
    knows = sifted & taken & (hers == bases) & (found == right)
    wrong = sifted & (outcomes != right)
    return Spied(int(sifted.sum()), int(knows.sum()), int(wrong.sum()))


def photon_splitting(defended: bool, bits: int) -> tuple[int, int]:
    """Keep a photon of each pulse of several; return bits known, of how many.

    The defence is decoy states, by which the ends find how much light of single photons comes.
    """
    values: Values = {
        LOSS.name: HIDDEN_DB,
        splitting.MEAN.name: 0.5,
        splitting.EVE.name: "on",
        splitting.DECOYS.name: "on" if defended else "off",
        "pairs": PULSES_PER_BIT * 2 * bits,
    }
    found, known = asyncio.run(splitting.exchange(values, SEED))
    of_key, pulses = found.counts[X], int(found.sent.sum())
    spied = Spied(int(of_key.sum()), int(known[X]), int(of_key[1].sum()))
    length = float(spied.bits)
    if defended:
        length = key(Decoys(splitting.means_of(values)), found.counts, pulses).value * pulses
    return spied.left(length), spied.bits
