"""Blocks of an end of a chain, of which several are under way."""

from typing import Any, cast

import numpy as np
import pytest

from hosts.hardware.qnic import Qnic
from hosts.middleware.services.distribution.pairs import Pairs
from hosts.middleware.services.swapping import Blocks
from hosts.middleware.session.analyser_socket import Swapped
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import Concurrently, Do, HostSide, WaitUntil
from hosts.middleware.session.values import Lifetimes, values
from wire.analyser_frames import MAX_UNDER_WAY
from wire.features import EVERYTHING, NodeFeatures
from wire.metadata.setup import Setup
from wire.metadata.values import Topic
from wire.metadata.vocabulary import Handshake, Service

SETUP = Setup(5, Service.SWAP, Handshake.FRAMED, "10.0.0.3", 8, 1, 1_000_000)
FOREVER = Lifetimes(np.inf, np.inf, np.inf, np.inf)
NO_FRAMES = cast("Any", None)  # of analysers: none is read here


def side() -> HostSide:
    features = NodeFeatures(EVERYTHING, 1000)
    random = np.random.default_rng(1)
    return HostSide(SETUP, (), "10.0.0.1", "bob", random, features, FOREVER, frozenset())


def test_no_more_blocks_are_begun_than_may_be_under_way() -> None:
    blocks, pairs = Blocks(side(), NO_FRAMES, 1), Pairs(side(), 1, 0.0)
    for number in range(1, MAX_UNDER_WAY + 1):
        begun = next(blocks.share(pairs, values(SETUP.session, Topic.COMING, number, [8], 32)))
        assert isinstance(begun, Concurrently)
    assert blocks.under_way == {1, 2, 3, 4}
    with pytest.raises(SessionError, match="4 may be under way"):
        next(blocks.share(pairs, values(SETUP.session, Topic.COMING, 5, [8], 32)))


def test_waits_in_switches_are_means_over_the_pairs_of_all_blocks() -> None:
    """30 pairs that waited 2 ms and 10 that waited 4: 2.5 ms at the first place."""
    blocks, pairs = Blocks(side(), NO_FRAMES, 1), Pairs(side(), 1, 0.0)
    for count, first_us, second_us in ((30, 2000, 500), (10, 4000, 500)):
        none = np.zeros(0, np.uint8), np.zeros(0, np.intp), list[int]()
        waited_us = {2: second_us, 1: first_us}
        blocks._note_waits(pairs, Swapped(*none, waited_us), count, 7_000_000)
    assert pairs.facts.repeaters_waited_ms == pytest.approx([2.5, 0.5])
    assert pairs.facts.waited_ms == pytest.approx(7)


def test_a_block_has_its_name_after_the_light_of_earlier_ones() -> None:
    """The pairs of block 2 have the name that light of block 1 has until its pairs are named."""
    swapped = Swapped(np.zeros(8, np.uint8), np.arange(8), [], {})
    end = side()
    blocks = Blocks(end, NO_FRAMES, 0)
    starts = [blocks._swapped(number, 8) for number in (1, 2)]
    assert all(isinstance(next(start), WaitUntil) for start in starts)
    second, first = (blocks._name(number, end.block(number), swapped) for number in (2, 1))
    wait = next(second)
    assert isinstance(wait, WaitUntil)
    assert not wait.done()
    next(first)
    assert next(first) == Do(Qnic.gather, (end.block(1), {end.block(2): swapped.positions}), {})
    assert not wait.done()
    with pytest.raises(StopIteration):
        next(first)
    assert wait.done()
