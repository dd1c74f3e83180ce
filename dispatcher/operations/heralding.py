"""Heralded pairs: the attempts of two nodes' qubits, and what a station between them tells.

    alice   prepare, emit ---.                         .--- heard: the next attempt
                              \\                       /
    station                    *--- clicks of both ---*
                              /                       \\
    bob     prepare, emit ---'                         '---

An attempt takes the preparation and a round trip to the station, the longer of both; each host
emits so that light of both meets. As many modes as both have attempt at once. The hosts find
heralded pairs when news of them can have come: before that neither a request nor an event shows
them.
"""

import asyncio
from collections.abc import Callable, Sequence

import grpc
import numpy as np

from dispatcher.devices import hardware
from dispatcher.devices.heralding import ENTANGLED, KINDS
from dispatcher.layer import cutoff
from dispatcher.layer.layer import PhysicalLayer, block_name, tally
from dispatcher.layer.ownership import HALVES, Block, BlockName
from dispatcher.operations import limits
from dispatcher.operations.heralded_link import Link, Offer
from dispatcher.operations.heralds import Drawing, Heralded
from dispatcher.operations.station_path import StationPath, find_path
from dispatcher.refusal import Refusal, exhausted, invalid, precondition
from wire.dispatcher_pb2 import AttemptRequest, BellOutcomes
from wire.features import HERALD
from wire.optical import DEFAULT_FREQUENCY_MHZ
from wire.outcomes import BELL_STATES

MOST_ATTEMPTS = (1 << 32) - 1  # of a block: a switch's frame counts no more
NEVER_NS = 1 << 63  # so far no clock gets
# The state of each half without entanglement, by kind; shape (kinds, 2).
BITS = np.array([[0, 0] if kind == ENTANGLED else [*map(int, kind)] for kind in KINDS], np.uint8)

Offers = tuple[Offer, Offer]  # of halves 0 and 1
Paths = tuple[StationPath, StationPath]


class Heralding:
    def __init__(
        self,
        layer: PhysicalLayer,
        failed: Callable[[BaseException], None],
        came: Callable[[BlockName], None] = lambda _name: None,
    ) -> None:
        """Act on this layer; call `failed` with what ends the telling of hosts unexpectedly.

        Call `came` with a block that its node has heard of.
        """
        self._layer, self._failed, self._came = layer, failed, came
        self._news: set[asyncio.Task[None]] = set()  # on its way to hosts

    async def announced(self) -> None:
        """Wait until all hosts can have heard of what is heralded."""
        while self._news:
            await asyncio.wait(self._news)

    def offer(self, node: str, request: AttemptRequest) -> Offer:
        layer, name, port = self._layer, block_name(request.block), request.port
        frequency_mhz = request.frequency_mhz or DEFAULT_FREQUENCY_MHZ
        cutoff_s = cutoff.requested(request)
        if cutoff_s is None:
            cutoff_s = layer.devices.of(node).memory.cutoff_s
        hardware.require(layer.devices, node, HERALD)
        end = layer.network.require_port(node, port)
        if name.half not in HALVES:
            raise invalid(f"half {name.half} of a pair; name 0 or 1")
        if any(layer.ownership.taken(name._replace(half=half), node) for half in HALVES):
            raise Refusal(grpc.StatusCode.ALREADY_EXISTS, f"{name} exists; take another number")
        layer.record(node, "attempt", port=port, detail=str(name))
        return Offer(name, end, frequency_mhz, cutoff_s)

    async def between(
        self,
        node: str,
        offers: Offers,
        ports: Sequence[str],
        count: int,
        limits_s: tuple[float, float],
    ) -> BellOutcomes:
        """Herald pairs of two nodes that attempt, whose light comes to these ports of a station.

        The limits are of a block, and of its first pair. Raise Refusal before any attempt.
        """
        layer = self._layer
        one, other = (self._path(node, *each) for each in zip(offers, ports, strict=True))
        link = self._link(node, offers, (one, other))
        self._require_capacity(offers, count)
        most = MOST_ATTEMPTS // link.modes
        longest = (round(each_s * 1e9) // link.period_ns for each_s in limits_s)
        rounds, first = (max(min(each, most), 1) for each in longest)
        drawing = Drawing(layer, node, link, [offer.name for offer in offers])
        heralded, used = await drawing.draw(count, rounds, first)
        block = None
        if heralded.count:
            block = self._keep(node, link, offers, heralded)
        else:
            self._keep_none(node, link, offers)
        detail = (
            f"{tally(heralded.bell_states, BELL_STATES)} of {used * link.modes} attempts".strip()
        )
        detail += f", dropped={drawing.dropped}" if drawing.dropped else ""
        layer.record(node, "herald", block, detail=detail)
        layer.approximations |= heralded.approximations
        return BellOutcomes(
            end=BellOutcomes.HERALDED,
            photons=heralded.count,
            outcomes=heralded.bell_states.tobytes(),
            attempts=used * link.modes,
        )

    def _path(self, node: str, offer: Offer, port: str) -> StationPath:
        """Return the way of the light of who attempts; refuse one that ends elsewhere by now."""
        path = find_path(self._layer, offer.end, offer.frequency_mhz)
        if (path.end.node, path.end.port) != (node, port):
            text = f"light of {offer.end.node} comes to {path.end.port} of {path.end.node}, not to "
            raise precondition(f"{text}{port} of {node}: open its path to there first")
        return path

    def _link(self, node: str, offers: Offers, paths: Paths) -> Link:
        """Return the link between two nodes that attempt; refuse what cannot be heralded."""
        layer = self._layer
        one, other = (layer.devices.of(offer.end.node) for offer in offers)
        if one.emitter.scheme != other.emitter.scheme:
            raise precondition(
                f"{offers[0].end.node} attempts by {one.emitter.scheme} and {offers[1].end.node} "
                f"by {other.emitter.scheme}: give both the same emitter.scheme"
            )
        if one.emitter.scheme == "two-click":
            for device in (one, other):
                hardware.require_encoding(layer.devices, node, device.source.encoding)
        start_ns = layer.clock.now_ns()
        cutoff_ns = min(offer.cutoff_s for offer in offers) * 1e9
        station = layer.devices.of(node)
        link = Link((one, other), paths, station, start_ns, cutoff_ns)
        if link.youngest_ns > cutoff_ns:
            raise precondition(
                f"pairs are {link.youngest_ns / 1e9:g} s old when they are heralded, and dropped "
                f"when they are older than {cutoff_ns / 1e9:g} s: choose a longer memory.cutoff_s"
            )
        return link

    def _require_capacity(self, offers: Offers, count: int) -> None:
        """Refuse, before any attempt, what the memories or the dispatcher cannot hold."""
        layer = self._layer
        for offer in offers:
            layer.memories.require_capacity(offer.end.node, count, NEVER_NS)
        limits.require_blocks(layer, 1, *(offer.end.node for offer in offers))
        live, most = layer.sabot.live_qubits, layer.max_live_qubits
        if live + 2 * count > most:
            raise exhausted(
                f"{2 * count} more qubits with {live} live exceed the limit of {most}; discard "
                "some first"
            )

    def _keep(
        self,
        node: str,
        link: Link,
        offers: Offers,
        heralded: Heralded,
    ) -> Block:
        """Let pairs that a node has heralded be in the memories of both; return half 0."""
        layer = self._layer
        lineages = {
            numbers: layer.ownership.used_names.use(*numbers)
            for numbers in dict.fromkeys(offer.name[:2] for offer in offers)
        }
        blocks = []
        registers = layer.sabot.bell_pairs(heralded.count)
        for half, (register, offer) in enumerate(zip(registers, offers, strict=True)):
            name, place = offer.name, offer.end.node
            came_ns = link.emitted_ns(half, heralded.rounds)
            block = Block(name, register, place, came_ns=came_ns, lineage=lineages[name[:2]])
            if memory := layer.network.memories.get(place):
                block.port, block.pulses.frequency_mhz = memory.ports[0], offer.frequency_mhz
            block.first_ns, block.last_ns = came_ns[[0, -1]].tolist()
            block.start_ns, block.pulses.approximations = block.first_ns, heralded.approximations
            blocks.append(block)
        self._set_states(blocks, heralded)
        for block, offer, path in zip(blocks, offers, link.paths, strict=True):
            self._hold(node, block, offer, path)
        return blocks[0]

    def _keep_none(self, node: str, link: Link, offers: Offers) -> None:
        """Let memories of switches hold blocks without a pulse, which are swapped in their turn."""
        layer, now_ns = self._layer, self._layer.clock.now_ns()
        for offer, path in zip(offers, link.paths, strict=True):
            if memory := layer.network.memories.get(offer.end.node):
                zero, place, port = layer.sabot.zeros(1), offer.end.node, memory.ports[0]
                block = Block(offer.name, zero, place, port, now_ns, now_ns, start_ns=now_ns)
                block.lineage = layer.ownership.used_names.use(*offer.name[:2])
                layer.sabot.lose(block.register, np.ones(1, bool))
                self._hold(node, block, offer, path)

    def _hold(self, node: str, block: Block, offer: Offer, path: StationPath) -> None:
        block.heard_ns = self._news_ns(node, path, block.node)
        self._layer.memories.store(block, offer.cutoff_s)
        self._tell(block)

    def _news_ns(self, node: str, path: StationPath, host: str) -> int:
        """Return when a host can hear of what a node has just found: by light, or copper."""
        layer = self._layer
        part = layer.network.analysers.get(node)
        copper_ns = layer.news.from_ns(part.switch if part else node, host)
        delay_ns = path.delay_ns if copper_ns is None else min(path.delay_ns, copper_ns)
        return layer.clock.now_ns() + max(delay_ns - 1, 0)  # what is rounded up is not late

    def _tell(self, block: Block) -> None:
        self._layer.ownership.add_when_heard(block)
        task = asyncio.create_task(self._heard(block))
        self._news.add(task)
        task.add_done_callback(self._end_news)

    async def _heard(self, block: Block) -> None:
        """Record that a host hears of a block; discard it if nobody wants it there any more.

        So does a host that has filled its memory meanwhile: qubits that attempted are in use again.
        """
        layer = self._layer
        await layer.clock.wait_until(block.heard_ns)
        layer.record(block.node, "heralded", block)
        node, session = block.node, block.name.session
        if block not in layer.ownership.of_session(node, session):
            return
        if layer.ownership.is_closed(node, session) or not layer.memories.has_capacity(node):
            layer.record(node, "discard", block)
            layer.drop(block)
        else:
            self._came(block.name)

    def _end_news(self, task: asyncio.Task[None]) -> None:
        self._news.remove(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._failed(error)

    def _set_states(self, blocks: Sequence[Block], heralded: Heralded) -> None:
        """Make of Phi+ what was heralded: a Bell state, or a state of the Z basis; with errors."""
        sabot, unentangled = self._layer.sabot, heralded.kind > 0
        sabot.pauli(blocks[1].register, heralded.bell_states)
        for half, block in enumerate(blocks) if unentangled.any() else ():
            purpose = block.draws_for("heralded reset")
            draws = self._layer.draws.photons(block.name, purpose, heralded.count)
            sabot.reset(block.register, unentangled, draws)
            sabot.pauli(block.register, BITS[heralded.kind, half])
        for block, paulis in zip(blocks, heralded.paulis, strict=True):
            sabot.explain(block.register, "heralded with errors", paulis)
            sabot.pauli(block.register, paulis)
