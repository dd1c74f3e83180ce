"""Entanglement swapping: two hosts make pairs and send halves to a switch that Bell-measures.

    alice                          q1                          bob
      | Values(COMING) ---------------------------------------> |
      | -- light, half 1 ----------> | <---------- light, half 1 |
      | <- frame of outcomes ------- | ------ frame of outcomes -> |  real frames
      | Values(SWAPPED: analysers, numbers) -------------------> |  both mean the same blocks
      | Values(ARRIVED) <--------------------------------------> |  bob corrects; both keep

If memories emit, both attempt, stations in switches report the pairs, and bits of swaps follow.

Flow entries of the switch lead light and frames: nobody here knows where it is. In a chain of
switches all report, and the outcomes multiply. If the controller programs it, several blocks are
under way. The pairs are then used as in entanglement distribution.
"""

from collections import defaultdict, deque
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np

from hosts.hardware import pair_light
from hosts.hardware.block_name import BlockName
from hosts.hardware.qnic import Qnic
from hosts.middleware.services.distribution.delivery import make_pairs, share_pairs
from hosts.middleware.services.distribution.pairs import Mask, Moments, Pairs
from hosts.middleware.services.distribution.purification import (
    DistributeOptions,
    Protocol,
    compare,
)
from hosts.middleware.session.analyser_socket import AnalyserSocket, Swapped, analyser_socket
from hosts.middleware.session.blocks import store, stored_since, take
from hosts.middleware.session.ends import AcceptorEnd, Answerer, OpenerEnd, ServiceKind
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.protocol import (
    Concurrently,
    HostSide,
    Now,
    Steps,
    Tell,
    Wait,
    WaitUntil,
    coming,
    do,
    hear,
    own_pairs,
)
from hosts.timeouts import HERALD_TIMEOUT_S, WHOLE_HZ
from wire.analyser_frames import MAX_UNDER_WAY, PHOTONS, THIRD, AnalyserFrame, Receivers
from wire.metadata.values import Topic, Values
from wire.metadata.vocabulary import MemoryState, Reason, Service
from wire.outcomes import NO_COINCIDENCE
from wire.parameters.option import option
from wire.services import switches_used

LARGEST = (1 << 32) - 1
MOST_SWITCHES = 64


@dataclass(frozen=True)
class SwapOptions(DistributeOptions):
    """Pairs by way of switches that swap."""

    swaps: int = option(
        0,
        "number of quantum switches that swap (all that can); 0: another controller programs them",
        metavar="N",
        range=(0, MOST_SWITCHES),
    )

    def asked(self) -> dict[str, Any]:
        return {**super().asked(), "block": self.swaps}


class Blocks:
    """How one end has blocks swapped: several under way, their light one after the other."""

    def __init__(
        self, side: HostSide, frames: AnalyserSocket, half: int, whole: bool = False
    ) -> None:
        """Half 0 is kept by the opener, 1 by the acceptor; `whole`: nobody wants a part of one."""
        self._side, self._frames, self._half, self._whole = side, frames, half, whole
        self._switches = switches_used(side.setup)
        self._dark: deque[int] = deque()  # blocks whose light is to be made, in order
        self._lit = 0  # blocks whose light was made
        self._unnamed: deque[int] = deque()  # blocks whose pairs have names of light, in order
        self.under_way: set[int] = set()
        self._waited: defaultdict[int, Moments] = defaultdict(Moments)  # in switches, by place

    def make(self, pairs: Pairs, number: int, size: int) -> Steps[None]:
        """Have a block swapped as the opener, and keep what both ends have."""
        side = self._side
        swapped, mask, since_ns = yield from self._swapped(number, size)
        if swapped.rounds:
            pairs.facts.span_rounds = swapped.rounds
        yield side.say(Topic.SWAPPED, number, swapped.blocks, 32)
        yield side.say(Topic.ARRIVED, number, mask, 1)
        theirs = yield from hear(Topic.ARRIVED, number, mask.size, 1)
        yield from self._name(number, side.block(number), swapped)
        pairs.facts.attempts += swapped.attempts
        emitted = swapped.heralded if self._is_heralded else size
        yield from pairs.share(number, mask, theirs.astype(bool), emitted, since_ns)

    def share(self, pairs: Pairs, message: Values) -> Steps[None]:
        """Do the same at the end that corrects, beside other blocks."""
        number, size = coming(message, self._side.setup.pairs)
        if len(self.under_way) >= MAX_UNDER_WAY:
            text = f"block {number} beside {sorted(self.under_way)}: {MAX_UNDER_WAY} may be under "
            raise SessionError(Reason.PROTOCOL, f"{text}way")
        self.under_way.add(number)
        yield Concurrently(self._share(pairs, number, size))

    def _share(self, pairs: Pairs, number: int, size: int) -> Steps[None]:
        side = self._side
        swapped, mask, since_ns = yield from self._swapped(number, size)
        theirs = yield from hear(Topic.SWAPPED, number, len(swapped.blocks), LARGEST)
        if theirs.tolist() != swapped.blocks:
            text = f"{side.peer} heard of other blocks at analysers than this host: let no other "
            raise SessionError(Reason.PROTOCOL, text + "session use them")
        arrived = yield from hear(Topic.ARRIVED, number, mask.size, 1)
        name = side.block(number, half=1)
        yield from self._name(number, name, swapped)
        if mask.size:
            turned = swapped.outcomes ^ side.setup.rotation
            operators = np.where(mask, turned, 0).astype(np.uint8)
            corrected_ns = yield from do(Qnic.apply, name, operators)
            self._note_waits(pairs, swapped, int(np.count_nonzero(mask)), corrected_ns - since_ns)
            mask &= yield from store(name)
        emitted = swapped.heralded if self._is_heralded else size
        yield from pairs.share(number, mask, arrived.astype(bool), emitted, since_ns)
        self.under_way.remove(number)  # others read its messages from now on
        yield side.say(Topic.ARRIVED, number, mask, 1)
        yield Tell(pairs.summary((yield Now())))

    def _note_waits(self, pairs: Pairs, swapped: Swapped, count: int, waited_ns: int) -> None:
        """Note how long halves of pairs waited here for outcomes, and in switches to be swapped."""
        pairs.corrected(count, waited_ns)
        for place, waited_us in swapped.waited_us.items():
            self._waited[place].add(count, waited_us / 1e6)
        waits = [waited.mean_s * 1e3 for _place, waited in sorted(self._waited.items())]
        pairs.facts.repeaters_waited_ms = waits or None

    def _swapped(self, number: int, size: int) -> Steps[tuple[Swapped, Mask, int]]:
        """Send halves of pairs to the switch; return the swaps, and which of them made pairs.

        Also return since when (ns) the halves that stay wait, on average.
        """
        side, switches = self._side, self._switches
        self._dark.append(number)
        self._unnamed.append(number)
        yield WaitUntil(lambda: self._dark[0] == number)
        if not switches:  # whose frames are to everybody
            self._frames.forget()
        if not self._half:
            yield side.ready(number, size)
        if self._is_heralded:
            heralded = yield from self._heralded(number, size)
            self._dark.popleft()
            return heralded
        stored = yield from own_pairs(side, 2 * number + self._half, size, side.ports[0])
        self._dark.popleft()
        self._lit += 1
        if switches:
            yield Concurrently(self._purify(self._kept(number), self._lit))
        awaited = partial(self._frames.next, size, max(1, switches), number=self._lit)
        swapped: Swapped = yield Wait(awaited)
        here = stored.arrived[swapped.positions] if not swapped.rounds else swapped.outcomes >= 0
        return swapped, here & (swapped.outcomes != NO_COINCIDENCE), stored.since_ns

    @property
    def _is_heralded(self) -> bool:
        return self._side.setup.memory == MemoryState.HERALDED

    def _heralded(self, number: int, size: int) -> Steps[tuple[Swapped, Mask, int]]:
        """Let qubits attempt to emit to a station in a switch; return the same."""
        name, since_ns, long_s = self._kept(number), 0, size / WHOLE_HZ
        wavelength_pm, most_s = self._side.setup.wavelength_pm, long_s if self._whole else 0.0
        yield from do(pair_light.attempt, name, self._side.ports[0], wavelength_pm, size, most_s)
        self._lit += 1
        if self._switches:
            yield Concurrently(self._purify(name, self._lit))
        chains, limit_s = max(1, self._switches), HERALD_TIMEOUT_S + long_s
        swapped: Swapped = yield Wait(partial(self._frames.next, size, chains, limit_s, self._lit))
        if swapped.outcomes.size:
            since_ns = yield from stored_since(name)
        return swapped, swapped.outcomes != NO_COINCIDENCE, since_ns

    def _purify(self, name: BlockName, block: int) -> Steps[None]:
        """Do the rounds of purification before swaps that the controller commands."""
        # Blocks in use meanwhile are not those beside pairs that are delivered.
        names = name, replace(name, half=1 - self._half)
        while True:
            command: AnalyserFrame | None = yield Wait(partial(self._frames.round, block))
            if command is None:
                return
            symbols = np.frombuffer(command.outcomes, np.uint8)
            at = np.flatnonzero(symbols != NO_COINCIDENCE)
            if at.size < PHOTONS:
                raise SessionError(Reason.PROTOCOL, f"{at.size} pairs of block {block} to purify")
            yield from take(name, {name: at})
            protocol, turns = Protocol(command.method // 2), divmod(symbols[at], THIRD)
            bits = yield from compare(names, self._half, protocol, turns[1], turns[0])
            yield Wait(partial(self._frames.answer, command, bits))

    def _name(self, number: int, name: BlockName, swapped: Swapped) -> Steps[None]:
        """Give the pairs of a block its name, which light of an earlier block may have had."""
        yield WaitUntil(lambda: self._unnamed[0] == number)
        yield from take(name, {self._kept(number): swapped.positions})
        self._unnamed.popleft()

    def _kept(self, number: int) -> BlockName:
        return self._side.block(2 * number + self._half)


async def swap(end: OpenerEnd, options: DistributeOptions) -> Answerer:
    judged = options.fidelity or options.sample or options.rounds
    whole = not judged and end.side.lifetimes.cutoff_s == inf and switches_used(end.setup) == 1
    with analyser_socket(end.setup.session, Receivers.OPENER) as frames:
        end.channel.sort()
        heralded = end.setup.memory == MemoryState.HERALDED
        most = MAX_UNDER_WAY if end.setup.block and not heralded else 1
        return await make_pairs(end, options, Blocks(end.side, frames, 0, whole).make, most)


async def receive(end: AcceptorEnd) -> Answerer:
    """Follow the opener until it delivers; return what answers this end's application."""
    with analyser_socket(end.setup.session, Receivers.ACCEPTOR) as frames:
        end.channel.sort()
        blocks = Blocks(end.side, frames, 1)
        return await share_pairs(end, blocks.share, blocks.under_way)


KIND = ServiceKind(Service.SWAP, SwapOptions, swap, receive)
