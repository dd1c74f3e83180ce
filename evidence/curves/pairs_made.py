"""How many pairs are made for those that are wanted: by both ends' own protocol, in the laboratory.

    alice-q0 ---- fibre ---- charlie-q0,  charlie-q1 ---- fibre ---- bob-q0

Of the pairs that come to both ends a sample is sacrificed for the estimate of their fidelity.
"""

import asyncio
import math
from collections import defaultdict
from contextlib import suppress
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dispatcher.laboratory import Laboratory, LaboratoryHost
from dispatcher.refusal import Refusal
from evidence.curves.estimates import Estimate, mean_of_draws
from evidence.curves.experiment import Experiment, Measure, Outcome, number
from evidence.curves.link import configuration, fiber
from evidence.curves.nested import Node
from evidence.curves.parameters import Parameter, Values
from hosts.hardware.operations import BlockName
from hosts.hardware.replies import Outcomes, Stored
from hosts.middleware.services.distribution.protocol import Opening, follow
from hosts.middleware.services.distribution.purification import DistributeOptions
from hosts.middleware.services.distribution.sharing import make, share
from hosts.middleware.session import protocol
from hosts.middleware.session.protocol import Effect, HostSide, Light, OpenerSide
from hosts.middleware.session.values import Lifetimes
from wire.features import EVERYTHING, NodeFeatures
from wire.metadata.header import Message
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service

WANTED = Parameter("wanted", 12, 1, 10_000)
LOSS = Parameter("loss_db", 0.0, 0.0, 30.0, "dB")
SAMPLE = Parameter("sample", 0.1, 0.0, 0.9)
REQUESTS = Parameter("requests", 100, 2, 10_000)
PORTS = {"alice": "alice-q0", "bob": "bob-q0"}
WAYS = ("charlie-q0", "alice-q0"), ("charlie-q1", "bob-q0")
SETUP = Setup(1, Service.DISTRIBUTE, Handshake.FRAMED, "10.0.0.3", 1 << 16, 1, 1_000_000)
FOREVER = Lifetimes(*[math.inf] * 4)
FEATURES = NodeFeatures(EVERYTHING, 1 << 20)
# As docs/distribution.md has it.
LEAST_SAMPLE, SPARE, GROWTH = 30, 1.05, 4
UNLIKELY = 1e-8  # what is not enumerated


class End(Node):
    """A host of the laboratory that hears its peer, with pairs of charlie."""

    def __init__(self, host: LaboratoryHost, charlie: LaboratoryHost) -> None:
        super().__init__(host)
        self._charlie = charlie
        self.inbox: asyncio.Queue[Message] = asyncio.Queue()
        self.peer: End

    async def carry_out(self, order: Effect) -> Any:
        match order:
            case protocol.Say(messages):
                for message in messages:
                    self.peer.inbox.put_nowait(message)
            case protocol.Hear() | protocol.HearNext():
                return await self.inbox.get()
            case protocol.Begin("receive_into_memory", (name, *_)):
                return Light(name)
            case protocol.Collect(light):
                return await self._stored(light)
            case protocol.Emit(block, pairs):
                await self._charlie.create(pairs, block)
                await self._charlie.send({(block, half): WAYS[half][0] for half in (0, 1)})
            case protocol.Tell():
                return None  # nobody listens
            case protocol.Now():
                return 1.0  # nothing that is measured depends on it
            case _:
                return await super().carry_out(order)
        return None

    async def _stored(self, light: Any) -> Stored | None:
        name: BlockName = light
        key = name.number, name.half
        if await self.host.receive(key, PORTS[self.host.name]) is None:
            return None
        return await self.store(name)

    async def outcomes(self, name: BlockName, bases: NDArray[np.uint8]) -> Outcomes:
        return Outcomes(await self.measure(name, bases), 0)

    async def discard_block(self, _session: int, number_: int) -> None:
        with suppress(Refusal):
            await self.host.discard((number_, int(self.host.name == "bob")))


async def request(values: Values, seed: int) -> Outcome:
    """Ask for pairs again and again; return how many were made for each that is wanted."""
    wanted, requests = int(number(values, WANTED.name)), int(number(values, REQUESTS.name))
    made = [await _made(values, each) for each in np.random.SeedSequence(seed).spawn(requests)]
    mean = mean_of_draws(made)
    return {"made": Estimate(mean.value / wanted, mean.error / wanted)}


async def _made(values: Values, seeds: np.random.SeedSequence) -> int:
    """Return how many pairs are made for one request."""
    seed = int(seeds.generate_state(1)[0])
    loss_db = number(values, LOSS.name) / 2
    fibers = [fiber(*way, length_km=0.0, connectors_db=loss_db) for way in WAYS]
    laboratory = Laboratory(configuration(seed, fibers))
    charlie = laboratory.host("charlie")
    alice, bob = (End(laboratory.host(name), charlie) for name in PORTS)
    alice.peer, bob.peer = bob, alice
    draws, others = np.random.default_rng(seed).spawn(2)
    like = FEATURES, FOREVER, frozenset(range(4))
    opener = OpenerSide(
        *(SETUP, ("alice-q0",), "bob", "alice", draws, *like, "bob", FEATURES, FOREVER, False)
    )
    acceptor = HostSide(SETUP, ("bob-q0",), "alice", "bob", others, *like)
    count, sample = int(number(values, WANTED.name)), number(values, SAMPLE.name)
    options = DistributeOptions("bob", SETUP.pairs, count=count, sample=sample)
    opening = Opening(opener, options, partial(make, opener), 0.0)
    following = follow(acceptor, partial(share, acceptor), 0.0)
    async with asyncio.TaskGroup() as both:
        pairs = both.create_task(alice.perform(opening.run()))
        both.create_task(bob.perform(following))
    return pairs.result().emitted


def expected(values: Values) -> float:
    """Return the mean, enumerated over all outcomes of each block of light.

    Asked for is what is missing of pairs and sample, by what has come so far, with one in twenty
    and a pair to spare; four times as much again until the first arrives. Surplus pairs are
    sampled, until there are enough of either, and of each block the share of --sample at least.
    """
    passes = 10 ** (-number(values, LOSS.name) / 10)
    return _mean(int(number(values, WANTED.name)), number(values, SAMPLE.name), passes)


@cache
def _mean(wanted: int, share_: float, passes: float) -> float:
    mean = 0.0
    least = LEAST_SAMPLE if share_ else 0
    states = {(0, 0, 0, 1): 1.0}  # pairs there, sampled and made, and the last block: how likely
    while states:
        after: defaultdict[tuple[int, int, int, int], float] = defaultdict(float)
        for (there, sampled, made, last), chance in states.items():
            missing, unknown = max(wanted - there, 0), max(least - sampled, 0)
            if made and not there + sampled:
                size = GROWTH * last
            else:
                kept = (there + sampled) / made if made else 1.0
                needed = max(missing + unknown, missing / (1 - share_))
                size = math.ceil(SPARE * needed / kept + 1)
            mean += chance * size
            for came, likely in _binomial(size, passes):
                for count, rounded in _rounded(share_ * came):
                    taken = max(count, min(came, there + came - wanted, unknown))
                    left, known = there + came - taken, sampled + taken
                    if left < wanted or known < least:
                        after[left, known, made + size, size] += chance * likely * rounded
        states = {state: chance for state, chance in after.items() if chance > UNLIKELY}
    return mean / wanted


@cache
def _binomial(size: int, passes: float) -> list[tuple[int, float]]:
    """Return how many of a block arrive, and how likely, without improbable numbers."""
    from scipy.stats import binom  # takes a second, which few need

    come = enumerate(binom.pmf(np.arange(size + 1), size, passes).tolist())
    return [(k, chance) for k, chance in come if chance > UNLIKELY]


def _rounded(share_: float) -> list[tuple[int, float]]:
    whole = int(share_)
    return [(whole, whole + 1 - share_), (whole + 1, share_ - whole)]


PAIRS_MADE = Experiment(
    "pairs-made",
    "pairs made for each that is wanted, with a sample for the estimate",
    (WANTED, LOSS, SAMPLE, REQUESTS),
    (Measure("made", "pairs made for each that is wanted", expected, logarithmic=True),),
    request,
)
