"""The sifted bits that are disclosed: a sample, a basis, or with decoys of both ends both.

The error rate that corrections begin with is that of the sample, where there is one; otherwise that
of the basis. With lasers at both ends of a relay bits of X are wrong in a quarter of all cases.
"""

from enum import Enum, auto

import numpy as np

from applications.qkd import decoy, relayed_decoys
from applications.qkd.bits import Bits, Mask
from applications.qkd.public_randomness import subset
from hosts.middleware.session.estimation import Estimate


class Rule(Enum):
    SAMPLE = auto()  # of all bits
    BASIS = auto()  # all bits of the basis Z
    BASIS_AND_SAMPLE = auto()  # all bits of the basis X, and a sample of the others


def size(rule: Rule, bases: Bits, fraction: float) -> int:
    """Return how many bits are disclosed; 0 if that would leave none."""
    if rule is Rule.SAMPLE:
        return sample_size(bases.size, fraction)
    if rule is Rule.BASIS:
        tested = int(np.count_nonzero(bases == decoy.TEST_BASIS))
        return tested if tested < bases.size else 0
    others = int(np.count_nonzero(bases != relayed_decoys.TEST_BASIS))
    sampled = sample_size(others, fraction) if others else 0
    return bases.size - others + sampled if sampled else 0


def mask(rule: Rule, bases: Bits, fraction: float, seed: bytes) -> Mask:
    if rule is Rule.SAMPLE:
        return sample_mask(seed, bases.size, size(rule, bases, fraction))
    if rule is Rule.BASIS:
        tested: Mask = bases == decoy.TEST_BASIS
        return tested
    chosen: Mask = bases == relayed_decoys.TEST_BASIS
    others = np.flatnonzero(~chosen)
    chosen[others[sample_mask(seed, others.size, sample_size(others.size, fraction))]] = True
    return chosen


def judged(rule: Rule, bases: Bits, disclosed: Mask) -> Mask:
    """Return which of the disclosed bits tell the error rate of the key."""
    if rule is Rule.BASIS_AND_SAMPLE:
        sampled: Mask = bases[disclosed] != relayed_decoys.TEST_BASIS
        return sampled
    return np.ones(int(np.count_nonzero(disclosed)), dtype=bool)


def sample_size(sifted: int, fraction: float) -> int:
    """Return how many of the sifted bits to disclose; 0 if that would leave none."""
    size = max(1, round(sifted * fraction))
    return size if size < sifted else 0


def sample_mask(seed: bytes, sifted: int, sample: int) -> Mask:
    """Return which sifted bits are disclosed, every subset of the size being as likely."""
    return subset(seed, "sample", sifted, sample)


def compare(mine: Bits, theirs: Bits) -> Estimate:
    """Count errors in a disclosed sample of alice's; ValueError if there is nothing to compare."""
    if mine.size == 0 or mine.shape != theirs.shape:
        raise ValueError(f"samples of {mine.size} and {theirs.size} bits cannot be compared")
    errors, ones = np.count_nonzero(mine != theirs), np.count_nonzero(mine)
    return Estimate(int(errors), mine.size, int(ones))
