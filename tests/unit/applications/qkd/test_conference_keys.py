"""Conference keys that both kinds of ends make of outcomes, against closed forms."""

from dataclasses import replace
from math import floor, log, log2, sqrt
from typing import Any

import numpy as np
import pytest

from applications.qkd.authentication import ForgedMessage, KeyPool, pool_bytes
from applications.qkd.conference import (
    KEY,
    MISSED,
    TEST_X,
    TEST_Z,
    Contradiction,
    Leader,
    Member,
    Pools,
    asymptotic_rate,
    disclosed,
    key_length,
    proved,
)
from applications.qkd.conference_proposal import ConferenceProposal
from applications.qkd.messages import Bound
from hosts.middleware.session.estimation import Estimate

NAMES = ("alice", "bob", "charlie")
TERMS = ConferenceProposal(7, Bound.FINITE, 1e-10, 1e-15, NAMES)
ERRORS = (0.01, 0.03)  # of bob's and charlie's bits
HASH_KEY = bytes(range(32))


def pools(place: int) -> tuple[Pools, Pools]:
    """Return the keys of the leader with another host, and of that one with the leader."""
    draws = np.random.default_rng(place)
    material = [draws.bytes(pool_bytes(3)) for _way in range(2)]
    mine, theirs = ([KeyPool(each) for each in material] for _ in range(2))
    return (mine[0], mine[1]), (theirs[1], theirs[0])


class Scene:
    """A leader and two members that have measured the same states."""

    def __init__(self, states: int = 40_000, terms: ConferenceProposal = TERMS) -> None:
        draws = np.random.default_rng(3)
        both = [pools(place) for place in range(2)]
        self.leader = Leader(terms, [mine for mine, _theirs in both])
        self.members = [
            Member(terms, name, theirs)
            for name, (_mine, theirs) in zip(NAMES[1:], both, strict=True)
        ]
        self.kinds = draws.choice([KEY, TEST_X, TEST_Z], states, p=[0.8, 0.1, 0.1])
        self.kinds = self.kinds.astype(np.uint8)
        in_x = self.kinds == TEST_X
        self.own = draws.integers(0, 2, states, dtype=np.uint8)
        others = [self.own ^ (draws.random(states) < error) for error in ERRORS]
        others[0] = np.where(in_x, draws.integers(0, 2, states), others[0])
        odd = draws.random(states) < 0.02
        others[1] = np.where(in_x, self.own ^ others[0] ^ odd, others[1])
        self.others = [each.astype(np.uint8) for each in others]
        self.others[0][:50] = MISSED
        reports = np.vstack([disclosed(self.kinds, each) for each in self.others])
        self.kept = self.leader.add_block(self.kinds, self.own, reports)
        for member, each in zip(self.members, self.others, strict=True):
            member.add_block(self.kinds, each, self.kept)

    def corrected(self) -> tuple[np.ndarray[Any, Any], bytes]:
        """Let all members correct their bits; return their results."""
        parities, proof = self.leader.parities(), proved(self.leader.raw, HASH_KEY)
        for member in self.members:
            assert member.correct(self.leader.worst, parities, proof)
        return parities, proof


def test_all_correct_by_one_syndrome_and_have_one_key() -> None:
    scene = Scene()
    leader = scene.leader
    parities, proof = scene.corrected()
    seed = np.random.default_rng(4).integers(0, 2, leader.raw.size - 1, dtype=np.uint8)
    length = leader.length
    keys = [leader.amplified(parities, proof, length, seed)]
    keys += [member.amplified(length, seed) for member in scene.members]
    assert length > 1000
    assert all(np.array_equal(key, keys[0]) for key in keys)
    assert keys[0].size == length
    for member, tag in zip(scene.members, leader.tags(), strict=True):
        member.check(tag)
    leader.check([member.tag() for member in scene.members])


def test_counts_are_those_of_states_that_all_have_seen() -> None:
    scene = Scene()
    leader, kept = scene.leader, scene.kept
    assert leader.states == kept.sum() == 39_950
    assert leader.in_x.sample == (scene.kinds[50:] == TEST_X).sum()
    assert leader.raw.size == (scene.kinds[50:] == KEY).sum()
    for found, error in zip([leader.in_x, *leader.in_z], (0.02, *ERRORS), strict=True):
        assert abs(found.qber - error) < 5 * sqrt(error * (1 - error) / found.sample)
    assert leader.worst == leader.in_z[1]


def test_bits_of_the_key_are_not_disclosed() -> None:
    kinds = np.array([KEY, KEY, TEST_X, TEST_Z, KEY], np.uint8)
    outcomes = np.array([0, 1, 1, 1, MISSED], np.uint8)
    assert disclosed(kinds, outcomes).tolist() == [0, 0, 1, 1, MISSED]


def test_errors_that_are_not_found_are_noticed() -> None:
    """The parities of a code that is right for 1 % of errors cannot put 30 % right."""
    scene = Scene(4000)
    member, leader = scene.members[0], scene.leader
    member._parts[0] ^= np.random.default_rng(5).random(member._parts[0].size) < 0.3
    parities, proof = leader.parities(), proved(leader.raw, HASH_KEY)
    assert not member.correct(leader.worst, parities, proof)


def test_a_receipt_is_of_one_block_and_of_the_host_that_gives_it() -> None:
    scene = Scene(4000)
    receipts = [member.receipt(1, 4000) for member in scene.members]
    scene.leader.check_receipts(1, 4000, receipts)
    again = [member.receipt(2, 4000) for member in scene.members]
    with pytest.raises(ForgedMessage):  # a receipt that was given before
        scene.leader.check_receipts(2, 4000, receipts)
    assert again != receipts


@pytest.mark.parametrize(("number", "states", "swapped"), [(2, 9, 0), (1, 8, 0), (1, 9, 1)])
def test_a_receipt_of_another_block_or_host_is_none(
    number: int, states: int, swapped: bool
) -> None:
    scene = Scene(4000)
    receipts = [member.receipt(1, 9) for member in scene.members]
    with pytest.raises(ForgedMessage):
        scene.leader.check_receipts(number, states, receipts[::-1] if swapped else receipts)


@pytest.mark.parametrize("what", ["parities", "hash", "length", "seed", "block", "terms", "name"])
def test_a_tag_fits_only_what_both_ends_know(what: str) -> None:
    """Whatever is another thing at one end, neither takes the other's tag."""
    scene = Scene(4000)
    mine, theirs = pools(0)
    terms = replace(TERMS, names=("alice", "bob"))
    leader = Leader(terms, [mine])
    heard = replace(terms, eps_sec=1e-9) if what == "terms" else terms
    member = Member(heard, "bobby" if what == "name" else "bob", theirs)
    report = disclosed(scene.kinds, scene.others[1])
    kept = leader.add_block(scene.kinds, scene.own, report[None])
    others = scene.others[1].copy()
    if what == "block":
        others[np.flatnonzero(scene.kinds == TEST_X)[0]] ^= 1
    member.add_block(scene.kinds, others, kept)
    parities, proof = leader.parities(), proved(leader.raw, HASH_KEY)
    seed = np.random.default_rng(4).integers(0, 2, leader.raw.size - 1, dtype=np.uint8)
    leader.amplified(parities, proof, 100, seed)
    if what == "parities":
        parities = parities ^ (np.arange(parities.size) == 3).astype(np.uint8)
    if what == "hash":
        proof = proof[:-1] + bytes([proof[-1] ^ 1])
    if what == "seed":
        seed = seed ^ (np.arange(seed.size) == 9).astype(np.uint8)
    member.correct(leader.worst, parities, proof)
    member.amplified(101 if what == "length" else 100, seed)
    with pytest.raises(ForgedMessage):
        member.check(leader.tags()[0])
    with pytest.raises(ForgedMessage):
        leader.check([member.tag()])


def test_what_cannot_be_is_no_key() -> None:
    scene = Scene(4000)
    kinds, own = np.zeros(3, np.uint8), np.array([1, MISSED, 0], np.uint8)
    with pytest.raises(Contradiction, match="not seen"):
        scene.members[0].add_block(kinds, own, np.ones(3, np.bool_))
    with pytest.raises(Contradiction, match="disclosed bits of the key"):
        scene.leader.add_block(kinds, own, np.array([[0, 0, 1], [0, 0, 0]], np.uint8))
    with pytest.raises(Contradiction, match="parities of"):
        scene.members[0].correct(Estimate(1, 100), np.zeros(5000, np.uint8), bytes(48))
    scene.corrected()
    with pytest.raises(Contradiction, match="bits of"):
        scene.members[0].amplified(10, np.zeros(10, np.uint8))


def entropy(p: float) -> float:
    return -p * log2(p) - (1 - p) * log2(1 - p)


def test_the_key_is_no_longer_than_the_bound_of_long_and_short_ones_says() -> None:
    """Tomamichel et al. 2012: n (1 - h(Q + mu)) - leak - log2(2/(eps^2 eps_cor)), at least.

    A host's key may differ with eps_cor by all other hosts together: half of it for each of two.
    """
    n, k, q, leaked = 80_000, 10_000, 0.02, 20_000
    in_x = Estimate(round(k * q), k)
    endless = key_length(replace(TERMS, bound=Bound.ASYMPTOTIC), n, in_x, leaked)
    assert endless == floor(n * (1 - entropy(q)) - leaked - 128)
    mu = sqrt((n + k) / (n * k) * (k + 1) / k * log(4 / 1e-10))
    least = n * (1 - entropy(q + mu)) - leaked - 128 - log2(2 / (1e-20 * 0.5e-15))
    assert floor(least) <= key_length(TERMS, n, in_x, leaked) < endless


def test_the_probability_of_unequal_keys_is_shared_among_the_other_hosts() -> None:
    """To the bit: n (1 - h(e)) - leak - log2(2 / (eps_sec^2 eps_cor / others)).

    Of k tests none is wrong, so that Hoeffding's bound is the tighter one (key_length.py), which
    has a closed form then: (1 - p)^k = (eps_sec / 4)^2 of key and tests, and e = p + p k / n.
    """
    n, k, leaked = 90_000, 40_000, 20_000
    p = 1 - (1e-10 / 4) ** (2 / k)
    errors = p + k / n * p
    for others in (1, 2, 3, 7):
        names = tuple(f"host{number}" for number in range(others + 1))
        shared = 1e-15 / others
        exact = n * (1 - entropy(errors)) - leaked - 128 - log2(2 / (1e-20 * shared))
        assert key_length(replace(TERMS, names=names), n, Estimate(0, k), leaked) == floor(exact)


def test_the_rate_of_endless_keys_is_that_of_theory() -> None:
    """1 - h(Q_X) - max h(Q_Z): h(.02) = .141441, h(.05) = .286397; zero at 11 % of both."""
    assert asymptotic_rate(0.02, 0.05) == pytest.approx(1 - 0.141441 - 0.286397, abs=1e-6)
    assert asymptotic_rate(0.1101, 0.1101) == 0
    assert asymptotic_rate(0.1099, 0.1099) > 0


def test_without_tests_there_is_no_key() -> None:
    scene = Scene(4000)
    leader = Leader(TERMS, [pools(0)[0], pools(1)[0]])
    only_key = np.zeros(4000, np.uint8)
    leader.add_block(only_key, scene.own, np.zeros((2, 4000), np.uint8))
    assert leader.length == 0
