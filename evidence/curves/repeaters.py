"""Chains of links by the hosts' own protocols: joined two by two, purified, and as many as wanted.

Theory is of Bell-diagonal pairs: probabilities of Phi+, Psi+, Phi- and Psi-, which add up to 1.

    alice-q0 ---- fibre ---- charlie-q0,  charlie-q1 ---- fibre ---- bob-q0

Of charlie's pairs that come to both ends a sample is sacrificed for the estimate of their fidelity.
"""

import asyncio
import math
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dispatcher.refusal import Refusal
from evidence.curves import theory
from evidence.curves.estimates import Estimate, mean_of_draws, proportion
from evidence.curves.experiment import Outcome
from evidence.curves.link import BASES, Ends, fiber, fidelity, network, share
from evidence.curves.parameters import Point
from evidence.laboratory import SESSION, Laboratory
from hosts.hardware import pair_light
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.hardware.replies import Stored
from hosts.hardware.simulated import SimulatedQnic
from hosts.middleware.services.distribution import sharing
from hosts.middleware.services.distribution.protocol import Opening, follow
from hosts.middleware.services.distribution.purification import (
    DistributeOptions,
    Protocol,
    purify,
)
from hosts.middleware.session import protocol
from hosts.middleware.session.performing import Performer
from hosts.middleware.session.protocol import Effect, HostSide, Light, OpenerSide
from hosts.middleware.session.values import Lifetimes
from wire.analyser_frames import PHOTONS
from wire.dispatcher_pb2 import Feedback, Step
from wire.features import EVERYTHING, NodeFeatures
from wire.metadata.header import Message
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Handshake, Service
from wire.parameters.physics import Device, Gates, PairSource

WAYS = {"alice": ("charlie-q0", "alice-q0"), "bob": ("charlie-q1", "bob-q0")}
SETUP = Setup(1, Service.DISTRIBUTE, Handshake.FRAMED, "10.0.0.3", 1 << 16, 1, 1_000_000)
FOREVER = Lifetimes(*[math.inf] * 4)
FEATURES = NodeFeatures(EVERYTHING, 1 << 20)
# As docs/distribution.md has it.
LEAST_SAMPLE, SPARE, GROWTH = 30, 1.05, 4
UNLIKELY = 1e-8  # what is not enumerated

Bell = tuple[float, float, float, float]
Theory = dict[str, float]


class LaboratoryQnic(SimulatedQnic):
    """A host's QNIC whose orders the laboratory performs, without a connection."""

    def __init__(self, laboratory: Laboratory, host: str) -> None:
        super().__init__("", "", [])
        self._laboratory, self._host = laboratory, host

    async def perform(self, *order: Step) -> list[Feedback]:
        feedbacks = []
        for step in order:
            operation = str(step.WhichOneof("operation"))
            request = getattr(step, operation)
            feedbacks.append(await self._laboratory.act(self._host, operation, request))
        return feedbacks


@dataclass
class Span:
    """Pairs of two nodes: the blocks of halves 0 and 1."""

    ends: tuple[int, int]
    blocks: tuple[int, int]
    pairs: int

    @property
    def names(self) -> list[BlockName]:
        return [BlockName(SESSION, block, half) for half, block in enumerate(self.blocks)]


class Chain:
    """Nodes in a row, each with a source and a fibre to the next."""

    def __init__(self, links: int, fidelity: float, seed: int, gates: Gates) -> None:
        names = [f"n{place}" for place in range(links + 1)]
        self.ways = [(f"{a}-q1", f"{b}-q0") for a, b in pairwise(names)]
        device = Device(source=PairSource(fidelity=fidelity), gates=gates)
        fibers = [fiber(*way, length_km=0.0) for way in self.ways]
        laboratory = network(seed, fibers, **dict.fromkeys(names, device))
        self.hosts = [laboratory.host(name) for name in names]
        self.nodes = [Performer(LaboratoryQnic(laboratory, name)) for name in names]

    async def link(self, place: int, pairs: int, block: int) -> Span:
        """Make pairs of a node and the next."""
        await share(self.hosts[place], self.hosts[place + 1], pairs, block, self.ways[place])
        return Span((place, place + 1), (block, block), pairs)

    def held(self, span: Span) -> Ends:
        return [
            (self.hosts[end], (block, half))
            for half, (end, block) in enumerate(zip(span.ends, span.blocks, strict=True))
        ]

    async def keep(self, span: Span, pairs: NDArray[np.integer]) -> None:
        for end, name in zip(span.ends, span.names, strict=True):
            await self.nodes[end].qnic.gather(name, {name: pairs})
        span.pairs = pairs.size

    async def purify(self, span: Span, protocol: Protocol) -> None:
        """Do a round at both ends, by their own protocol."""
        mine, yours = [
            await self.nodes[end].perform(purify(name, span.pairs, protocol, span.blocks[0]))
            for end, name in zip(span.ends, span.names, strict=True)
        ]
        await self.keep(span, np.flatnonzero(mine == yours))

    async def join(self, left: Span, right: Span) -> Span:
        """Swap at the node where two spans meet; keep as many as the smaller has."""
        pairs = min(left.pairs, right.pairs)
        for span in (left, right):
            await self.keep(span, np.arange(pairs))
        middle, last = self.hosts[left.ends[1]], self.hosts[right.ends[1]]
        outcomes = await middle.bell_measure((left.blocks[1], 1), (right.blocks[0], 0))
        await last.apply((right.blocks[1], 1), outcomes)
        return Span((left.ends[0], right.ends[1]), (left.blocks[0], right.blocks[1]), pairs)

    async def span(self, first: int, last: int, pairs: int, rounds: int, block: int) -> Span:
        """Return pairs of two nodes, made level by level and purified before each swap."""
        if last - first == 1:
            return await self.link(first, pairs, block + first)
        middle = (first + last) // 2
        halves = [
            await self.span(*ends, pairs, rounds, block)
            for ends in ((first, middle), (middle, last))
        ]
        for half in halves:
            for _round in range(rounds):
                await self.purify(half, Protocol.DEJMPS)
        return await self.join(*halves)


async def nested(v: Point, seed: int) -> Outcome:
    """Join links, and measure a third of the pairs in each basis at the ends."""
    links, rounds = 2 ** int(v.levels), int(v.rounds)
    chain = Chain(links, v.fidelity, seed, Gates())
    made = int(v.pairs) * PHOTONS ** (rounds * int(v.levels)) // len(BASES)

    async def joined(turn: int) -> Ends:
        return chain.held(await chain.span(0, links, made, rounds, turn * links))

    return {"fidelity": await fidelity(joined)}


def of_nested(v: Point) -> Theory:
    """Return the fidelity of Werner links joined two by two, purified before each swap.

    Briegel, Duer, Cirac and Zoller, Phys. Rev. Lett. 81, 5932.
    """
    wrong = (1 - v.fidelity) / 3
    pair = v.fidelity, wrong, wrong, wrong
    for _level in range(int(v.levels)):
        for _round in range(int(v.rounds)):
            pair = purified(pair)
        pair = swapped(pair, pair)
    return {"fidelity": pair[0]}


def swapped(one: Bell, other: Bell) -> Bell:
    """Return what a perfect swap makes of two pairs: their Pauli errors, multiplied."""
    first, second, third, fourth = (
        sum(one[error] * other[error ^ state] for error in range(4)) for state in range(4)
    )
    return first, second, third, fourth


def purified(pair: Bell) -> Bell:
    """Return what a round of DEJMPS makes of two pairs alike (Phys. Rev. Lett. 77, 2818, eq. 3)."""
    phi, psi, phi_minus, psi_minus = pair
    success = (phi + psi_minus) ** 2 + (psi + phi_minus) ** 2
    return (
        (phi**2 + psi_minus**2) / success,
        (psi**2 + phi_minus**2) / success,
        2 * phi * psi_minus / success,
        2 * psi * phi_minus / success,
    )


async def purification(v: Point, seed: int) -> Outcome:
    """Purify pairs by gates and readings that err; measure a third of what is left in each."""
    noise, misread = v.two_qubit_depolarizing, v.readout_error
    gates = Gates("any", two_qubit_depolarizing=noise, readout_error=misread)
    chain, pairs = Chain(1, v.fidelity, seed, gates), 0
    made = PHOTONS * int(v.pairs) // len(BASES)

    async def purified_link(turn: int) -> Ends:
        nonlocal pairs
        span = await chain.link(0, made, turn)
        for host, key in chain.held(span):  # readings are of what is kept
            await host.store(key)
        await chain.purify(span, Protocol.BBPSSW)
        pairs += span.pairs
        return chain.held(span)

    seen, read = await fidelity(purified_link), (1 - 2 * misread) ** 2
    # Two readings spoil each correlation.
    estimate = Estimate(1 / 4 + (seen.value - 1 / 4) / read, seen.error / read)
    return {"fidelity": estimate, "success": proportion(pairs, made * len(BASES) // PHOTONS)}


def of_purification(v: Point) -> Theory:
    after, success = theory.purified(v.fidelity, v.two_qubit_depolarizing, v.readout_error)
    return {"fidelity": after, "success": success}


class End(Performer):
    """A host that has a connection with its peer, and pairs of charlie."""

    def __init__(self, laboratory: Laboratory, name: str) -> None:
        super().__init__(LaboratoryQnic(laboratory, name))
        self._host, self._charlie = laboratory.host(name), laboratory.host("charlie")
        self.inbox: asyncio.Queue[Message] = asyncio.Queue()
        self.peer: End

    async def carry_out(self, effect: Effect) -> Any:
        match effect:
            case protocol.Say(messages):
                for message in messages:
                    self.peer.inbox.put_nowait(message)
            case protocol.Hear() | protocol.HearNext():
                return await self.inbox.get()
            case protocol.Begin(pair_light.receive_into_memory, (name, *_)):
                return Light(name)
            case protocol.Collect(light):
                return await self._stored(cast(BlockName, light))
            case protocol.Emit(block, pairs):
                await self._charlie.create(pairs, block)
                ports = {(block, half): way[0] for half, way in enumerate(WAYS.values())}
                await self._charlie.send(ports)
            case protocol.Tell():
                return None  # nobody listens
            case protocol.Now():
                return 1.0  # nothing that is measured depends on it
            case protocol.Do(Qnic.discard_block, (_session, number)):
                with suppress(Refusal):
                    await self._host.discard((number, list(WAYS).index(self._host.name)))
            case _:
                return await super().carry_out(effect)
        return None

    async def _stored(self, name: BlockName) -> Stored | None:
        if await self._host.receive((name.number, name.half), WAYS[self._host.name][1]) is None:
            return None
        return await self.qnic.store(name)


async def overhead(v: Point, seed: int) -> Outcome:
    """Ask for pairs again and again; return how many were made for each that is wanted."""
    seeds = np.random.SeedSequence(seed).spawn(int(v.requests))
    mean = mean_of_draws([await _made(v, int(each.generate_state(1)[0])) for each in seeds])
    return {"made": Estimate(mean.value / v.wanted, mean.error / v.wanted)}


async def _made(v: Point, seed: int) -> int:
    """Return how many pairs are made for one request."""
    fibers = [fiber(*way, length_km=0.0, connectors_db=v.loss_db / 2) for way in WAYS.values()]
    laboratory = network(seed, fibers)
    alice, bob = (End(laboratory, name) for name in WAYS)
    alice.peer, bob.peer = bob, alice
    draws, others = np.random.default_rng(seed).spawn(2)
    bells = frozenset(range(4))
    acceptor = HostSide(SETUP, ("bob-q0",), "alice", "bob", others, FEATURES, FOREVER, bells)
    own = replace(acceptor, ports=("alice-q0",), peer="bob", host="alice", draws=draws)
    opener = OpenerSide(
        **vars(own), other_host="bob", theirs=FEATURES, their_lifetimes=FOREVER, is_source=False
    )
    options = DistributeOptions("bob", SETUP.pairs, count=int(v.wanted), sample=v.sample)
    opening = Opening(opener, options, partial(sharing.make, opener), 0.0)
    following = follow(acceptor, partial(sharing.share, acceptor), 0.0)
    async with asyncio.TaskGroup() as both:
        pairs = both.create_task(alice.perform(opening.run()))
        both.create_task(bob.perform(following))
    return pairs.result().emitted


def of_overhead(v: Point) -> Theory:
    """Return the mean, enumerated over all outcomes of each block of light.

    Asked for is what is missing of pairs and sample, by what has come so far, with one in twenty
    and a pair to spare; four times as much again until the first arrives. Surplus pairs are
    sampled, until there are enough of either, and of each block the share of --sample at least.
    """
    return {"made": _mean(int(v.wanted), v.sample, theory.transmission(v.loss_db))}


@cache
def _mean(target: int, share_: float, passes: float) -> float:
    mean = 0.0
    least = LEAST_SAMPLE if share_ else 0
    states = {(0, 0, 0, 1): 1.0}  # pairs there, sampled and made, and the last block: how likely
    while states:
        after: defaultdict[tuple[int, int, int, int], float] = defaultdict(float)
        for (there, sampled, made, last), chance in states.items():
            missing, unknown = max(target - there, 0), max(least - sampled, 0)
            if made and not there + sampled:
                size = GROWTH * last
            else:
                fraction = (there + sampled) / made if made else 1.0
                needed = max(missing + unknown, missing / (1 - share_))
                size = math.ceil(SPARE * needed / fraction + 1)
            mean += chance * size
            for came, likely in _binomial(size, passes):
                for count, rounded in _rounded(share_ * came):
                    taken = max(count, min(came, there + came - target, unknown))
                    left, samples = there + came - taken, sampled + taken
                    if left < target or samples < least:
                        after[left, samples, made + size, size] += chance * likely * rounded
        states = {state: chance for state, chance in after.items() if chance > UNLIKELY}
    return mean / target


@cache
def _binomial(size: int, passes: float) -> list[tuple[int, float]]:
    """Return how many of a block arrive, and how likely, without improbable numbers."""
    from scipy.stats import binom  # takes a second, which few need

    come = enumerate(binom.pmf(np.arange(size + 1), size, passes).tolist())
    return [(k, chance) for k, chance in come if chance > UNLIKELY]


def _rounded(share_: float) -> list[tuple[int, float]]:
    whole = int(share_)
    return [(whole, whole + 1 - share_), (whole + 1, share_ - whole)]
