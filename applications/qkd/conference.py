"""A conference key: all hosts of a line make one key of outcomes of GHZ states.

N-BB84 (Grasselli, Kampermann, Bruss, New J. Phys. 20, 113014 (2018); Epping, Kampermann,
Macchiavello, Bruss, New J. Phys. 19, 093012 (2017)). Of each state the leader says, once it is in
all memories, what it is for: the key, in Z, where all have the same bit; a test in X, whose parity
is even; or a test in Z, which tells how much a host's bits differ from the leader's.

    leader                                              each other host
      | <------------------- receipt: a block is in memory |
      | kinds of states -------------------------------> |
      | <------- outcomes of tests, and what was not seen |
      | which states all have seen --------------------> |  block by block
      | one syndrome, for whose bits differ most ------> |  corrects
      | hash of the key -------------------------------> |  compares
      | length and seed of privacy amplification ------> |
      | tag of all this <------------------------------> |  with the key shared by these two

A receipt is tagged, and the leader says nothing of a block before it has those of all: who held
photons back until the kinds are known could measure those of the key in Z, and nobody would notice.
All else counts only when the tags at the end are right: then both ends have exactly the messages
of the other, and no key is kept otherwise (as the one tag for a round of Kiktenko
et al., IEEE Trans. Inf. Theory 66, 6354 (2020)). One syndrome goes to all, so that no more leaks
than the worst host needs. Pure thinking: no socket, clock or thread.
"""

import hashlib

import numpy as np
from numpy.typing import NDArray

from applications.qkd.amplification import seed_bits, toeplitz
from applications.qkd.authentication import (
    HASH_KEY_BYTES,
    TAG_BITS,
    Authenticator,
    KeyPool,
    key_tag,
)
from applications.qkd.bits import NO_BITS, Bits, pack, pack_levels
from applications.qkd.cascade import LEAST_QBER
from applications.qkd.conference_proposal import ConferenceProposal
from applications.qkd.key_length import asymptotic_key_length, binary_entropy, finite_key_length
from applications.qkd.ldpc_decoding import checks_for, corrected
from applications.qkd.messages import Bound
from applications.qkd.parities import rows, syndrome
from hosts.middleware.session.estimation import Estimate

KEY, TEST_X, TEST_Z = range(3)  # what a state is for
MISSED = 3  # instead of an outcome

Table = NDArray[np.uint8]  # shape (hosts, states)
Pools = tuple[KeyPool, KeyPool]  # of what this end says, and of what the other does


class Contradiction(Exception):
    """A message contradicts earlier ones, or the other end's own knowledge."""


def key_length(terms: ConferenceProposal, key_bits: int, in_x: Estimate, leaked_bits: int) -> int:
    """Return how many bits are secret; leaked_bits are those of the syndrome.

    The parity of all others predicts the leader's outcome in X but for the error rate
    of the tests, which is the number for the key: the uncertainty relation then bounds what anybody
    knows of Z as for two ends (key_length.py). That a host's key differs counts for each host.
    """
    leaked, others = leaked_bits + TAG_BITS, len(terms.names) - 1
    if terms.bound is Bound.ASYMPTOTIC:
        return asymptotic_key_length(key_bits, in_x.qber, leaked)
    eps_cor = terms.eps_cor / others
    return finite_key_length(key_bits, in_x.sample, in_x.qber, leaked, terms.eps_sec, eps_cor)


def asymptotic_rate(in_x: float, worst_in_z: float) -> float:
    """Return 1 - h(Q_X) - max h(Q_Z), at least 0: secret bits for each bit of endless keys."""
    return max(0.0, 1 - binary_entropy(in_x) - binary_entropy(worst_in_z))


def disclosed(kinds: Bits, outcomes: Bits) -> Bits:
    """Return what a host tells of its outcomes: those of tests, and what was missed."""
    hidden: Bits = np.where((kinds == KEY) & (outcomes != MISSED), 0, outcomes).astype(np.uint8)
    return hidden


def code_seed(terms: ConferenceProposal) -> bytes:
    """Return what all draw the code from; it may be known to anybody, also before."""
    return hashlib.sha256(b"code of a conference key " + terms.encode()).digest()


def proved(key: Bits, hash_key: bytes) -> bytes:
    return hash_key + key_tag(key, hash_key)


class Transcript:
    """All messages of two ends, as both know them."""

    def __init__(self, terms: ConferenceProposal, host: str, pools: Pools) -> None:
        self._messages = [terms.encode(), host.encode()]
        self._pools = pools
        self._signer, self._checker = (Authenticator(pool) for pool in pools)

    @property
    def consumed_bits(self) -> int:
        return sum(pool.consumed_bits for pool in self._pools)

    def add(self, *messages: bytes) -> None:
        self._messages += messages

    def receipt(self, number: int, states: int) -> bytes:
        """Return what proves to the leader that a block is in this host's memory."""
        return self._signer.tag(self._receipt(number, states))

    def check_receipt(self, number: int, states: int, receipt: bytes) -> None:
        """Raise ForgedMessage unless the host has this number of states of a block."""
        self._checker.check(self._receipt(number, states), receipt)

    def _receipt(self, number: int, states: int) -> bytes:
        terms, host = self._messages[:2]
        return b"receipt" + terms + host + number.to_bytes(8, "big") + states.to_bytes(8, "big")

    def tag(self) -> bytes:
        return self._signer.tag(self._whole())

    def check(self, tag: bytes) -> None:
        """Raise ForgedMessage unless the other end knows the same."""
        self._checker.check(self._whole(), tag)

    def _whole(self) -> bytes:
        lengths = b"".join(len(message).to_bytes(8, "big") for message in self._messages)
        return lengths + b"".join(self._messages)


def _of_block(kinds: Bits, reported: Bits, mask: NDArray[np.bool_]) -> list[bytes]:
    return [kinds.size.to_bytes(8, "big"), pack_levels(kinds), pack_levels(reported), pack(mask)]


def _of_end(parities: Bits, proof: bytes, length: int, seed: Bits) -> list[bytes]:
    return [pack(parities), proof, length.to_bytes(8, "big"), pack(seed)]


class Leader:
    """The end whose bits count as right."""

    def __init__(self, terms: ConferenceProposal, pools: list[Pools]) -> None:
        """Begin; pools: with each other host, in their order."""
        self.terms = terms
        self._transcripts = [
            Transcript(terms, name, each) for name, each in zip(terms.names[1:], pools, strict=True)
        ]
        self._parts: list[Bits] = []
        self.in_x = Estimate(0, 0)
        self.in_z = [Estimate(0, 0) for _ in pools]  # of each other host
        self.states = 0  # that all have seen

    @property
    def consumed_bits(self) -> int:
        """How many bits of keys shared with all others were used to authenticate messages."""
        return sum(transcript.consumed_bits for transcript in self._transcripts)

    def check_receipts(self, number: int, states: int, receipts: list[bytes]) -> None:
        """Raise ForgedMessage unless all others have a block in their memories."""
        for transcript, receipt in zip(self._transcripts, receipts, strict=True):
            transcript.check_receipt(number, states, receipt)

    def add_block(self, kinds: Bits, outcomes: Bits, reported: Table) -> NDArray[np.bool_]:
        """Take in the outcomes of a block; return which states all have seen, shape (k,)."""
        mask: NDArray[np.bool_] = (outcomes != MISSED) & (reported != MISSED).all(axis=0)
        if reported[:, kinds == KEY][reported[:, kinds == KEY] != MISSED].any():
            raise Contradiction("a host has disclosed bits of the key")
        for transcript, row in zip(self._transcripts, reported, strict=True):
            transcript.add(*_of_block(kinds, row, mask))
        tested = mask & (kinds == TEST_X)
        odd = (outcomes[tested] + reported[:, tested].sum(axis=0)) & 1
        self.in_x = self.in_x.beside(Estimate(int(odd.sum()), odd.size))
        tested = mask & (kinds == TEST_Z)
        for host, row in enumerate(reported):
            wrong = int(np.count_nonzero(row[tested] != outcomes[tested]))
            estimate = Estimate(wrong, int(np.count_nonzero(tested)))
            self.in_z[host] = self.in_z[host].beside(estimate)
        self._parts.append(outcomes[mask & (kinds == KEY)])
        self.states += int(np.count_nonzero(mask))
        return mask

    @property
    def raw(self) -> Bits:
        return np.concatenate([NO_BITS, *self._parts])

    @property
    def worst(self) -> Estimate:
        return max(self.in_z, key=lambda estimate: estimate.qber)

    @property
    def leaked_bits(self) -> int:
        return checks_for(self.raw.size, self.worst)

    @property
    def length(self) -> int:
        """How many bits are secret; 0 also where a test is missing."""
        if not (self.in_x.sample and self.worst.sample and self.raw.size):
            return 0
        return key_length(self.terms, self.raw.size, self.in_x, self.leaked_bits)

    def parities(self) -> Bits:
        code = rows(code_seed(self.terms), self.raw.size, self.leaked_bits)
        return syndrome(self.raw, code, self.leaked_bits)

    def amplified(self, parities: Bits, proof: bytes, length: int, seed: Bits) -> Bits:
        """Return the key; the tags authenticate its messages."""
        for transcript in self._transcripts:
            transcript.add(*_of_end(parities, proof, length, seed))
        return toeplitz(self.raw, seed, length)

    def tags(self) -> list[bytes]:
        """Return what proves all to each other host, in their order."""
        return [transcript.tag() for transcript in self._transcripts]

    def check(self, tags: list[bytes]) -> None:
        """Raise ForgedMessage unless all others know what this end does."""
        for transcript, tag in zip(self._transcripts, tags, strict=True):
            transcript.check(tag)


class Member:
    def __init__(self, terms: ConferenceProposal, name: str, pools: Pools) -> None:
        """Begin; pools: with the leader."""
        self.terms = terms
        self._transcript = Transcript(terms, name, pools)
        self._parts: list[Bits] = []
        self.raw: Bits = NO_BITS

    def receipt(self, number: int, states: int) -> bytes:
        """Return what proves that this number of states of a block is in this host's memory."""
        return self._transcript.receipt(number, states)

    def add_block(self, kinds: Bits, outcomes: Bits, mask: NDArray[np.bool_]) -> None:
        """Take in the outcomes of a block, and which states all have seen."""
        if (outcomes[mask] == MISSED).any():
            raise Contradiction("the leader keeps states that this host has not seen")
        self._transcript.add(*_of_block(kinds, disclosed(kinds, outcomes), mask))
        self._parts.append(outcomes[mask & (kinds == KEY)])

    def correct(self, worst: Estimate, parities: Bits, proof: bytes) -> bool:
        """Correct the bits; return whether they are the leader's, by a hash and its key before."""
        raw = np.concatenate([NO_BITS, *self._parts])
        if raw.size == 0 or parities.size >= raw.size:
            raise Contradiction(f"{parities.size} parities of {raw.size} bits")
        qber = max(worst.qber, LEAST_QBER)
        self.raw = corrected(raw, code_seed(self.terms), parities, qber)
        self._told = parities, proof
        return proved(self.raw, proof[:HASH_KEY_BYTES]) == proof

    def amplified(self, length: int, seed: Bits) -> Bits:
        if length > self.raw.size or seed.size != seed_bits(self.raw.size):
            raise Contradiction(f"{length} bits of {self.raw.size} by a seed of {seed.size}")
        self._transcript.add(*_of_end(*self._told, length, seed))
        return toeplitz(self.raw, seed, length)

    def tag(self) -> bytes:
        return self._transcript.tag()

    def check(self, tag: bytes) -> None:
        """Raise ForgedMessage unless the leader knows what this end does."""
        self._transcript.check(tag)
