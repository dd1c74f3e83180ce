"""What a node does to blocks it holds: each operation checks, then acts, then records."""

from collections.abc import Sequence

import grpc
import numpy as np

from dispatcher import drift, limits
from dispatcher.analyser import Analyser, Half
from dispatcher.chance import Chance
from dispatcher.detector import Train
from dispatcher.layer import PhysicalLayer, block_name, tally
from dispatcher.ownership import Block, BlockName
from dispatcher.pulses import further
from dispatcher.refusal import Refusal, exhausted, invalid
from dispatcher.sabot.backend import GateName
from dispatcher.sabot.draws import PhotonDraws
from dispatcher.sabot.manager import NO_CLICK
from dispatcher.sabot.registers import Register
from dispatcher.source import emit
from wire.dispatcher_pb2 import CreateRequest, Feedback, Gate, MeasureRequest

PAULIS = ("I", "X", "Z", "XZ")
BELL_STATES = ("Phi+", "Psi+", "Phi-", "Psi-")
BASES = ("Z", "X", "Y")
GATES: dict[int, GateName] = {
    Gate.H: "H",
    Gate.S: "S",
    Gate.S_DAG: "S_DAG",
    Gate.CX: "CX",
    Gate.CZ: "CZ",
}
STATES = {CreateRequest.BELL_PAIRS: ("Bell pairs", 2), CreateRequest.ZEROS: ("zeros", 1)}

PAIRS = ("none", "1", "2", "more")
COMMUTE_WITH_Z = ("S", "S_DAG", "CZ", "T", "T_DAG", "RZ")

PlannedGate = tuple[GateName, Block | None]


class Operations:
    """Create, apply, measure, store and discard."""

    def __init__(self, layer: PhysicalLayer) -> None:
        """Act on this layer."""
        self._layer = layer
        self.pairs_created = 0

    def create(self, node: str, request: CreateRequest) -> Feedback:
        """Make a block of Bell pairs or of zeros at the node."""
        layer = self._layer
        if request.state not in STATES:
            raise invalid(f"state {request.state} is unknown; use BELL_PAIRS or ZEROS")
        text, halves = STATES[request.state]
        names = [BlockName(request.session, request.number, half) for half in range(halves)]
        self._require_room(names, request.count)
        registers: Sequence[Register] = (
            [layer.sabot.zeros(request.count)]
            if halves == 1
            else (layer.sabot.bell_pairs(request.count))
        )
        now_ns = layer.clock.now_ns()
        blocks = [
            Block(name, register, node, first_ns=now_ns, last_ns=now_ns, start_ns=now_ns)
            for name, register in zip(names, registers, strict=True)
        ]
        for block in blocks:
            layer.ownership.add(block)
        if halves == 2:
            text += self._emit(node, blocks)
        layer.record(node, "create", blocks[0], detail=text)
        return layer.feedback(blocks[0])

    def _emit(self, node: str, halves: Sequence[Block]) -> str:
        """Make new pairs what the node's source emits; return what that is, for the log."""
        layer, source = self._layer, self._layer.devices.of(node).source
        first, count = halves[0], halves[0].register.size
        emission = emit(source, Chance(layer.draws, first.name, "source", count))
        told = ""
        if emission.paulis is not None:
            layer.sabot.pauli(first.register, emission.paulis)
            told += f": {tally(emission.paulis, BELL_STATES)}"
        for half in halves:
            half.source_rate_hz = source.max_rate_hz
            half.pulses.exact = emission.exact
            if emission.delays_ps is not None:
                half.pulses.delays_ps = emission.delays_ps.copy()
            if emission.pairs is not None:
                layer.sabot.lose(half.register, emission.pairs == 0)
                half.pulses.extras = further(emission.pairs)
        if emission.pairs is None:
            self.pairs_created += count
        else:
            self.pairs_created += int(emission.pairs.sum(dtype=np.int64))
            told += f", in pulses: {tally(np.minimum(emission.pairs, 3), PAIRS)}"
        return told

    def apply(self, node: str, name: BlockName, paulis: bytes, gates: Sequence[Gate]) -> Feedback:
        """Apply a Pauli to each photon, then Clifford gates to all of them."""
        layer = self._layer
        block = layer.ownership.require(name, node)
        planned = self._plan(node, block, gates)
        details: list[str] = [gate for gate, _target in planned]
        values = limits.packed("paulis", paulis, block.register.size, 3) if paulis else None
        for used in {block: None} | {target: None for _gate, target in planned if target}:
            layer.take_up(used)
        if values is not None:
            layer.sabot.pauli(block.register, values)
            drift.reflect(block.pulses, values)
            details.insert(0, tally(values, PAULIS))
        for gate, target in planned:
            self._twirl(gate, block, target)
            layer.sabot.gate(gate, block.register, target.register if target else None)
        layer.record(node, "apply", block, detail=" ".join(details))
        return layer.feedback(block)

    def measure(self, node: str, name: BlockName, basis: int, bases: bytes) -> Feedback:
        """Measure and use up every photon, each in its basis."""
        layer = self._layer
        block = layer.ownership.require(name, node)
        size = block.register.size
        if basis not in MeasureRequest.Basis.values():
            raise invalid(f"basis {basis} is unknown; use Z, X or Y")
        values = np.full(size, basis, np.uint8)
        if bases:
            values = limits.packed("bases", bases, size, 2)
        layer.take_up(block)
        if values.any():  # Z does not see the angles
            drift.twirl(block, layer.sabot, layer.draws)
        feedback = layer.feedback(block)
        bits = layer.sabot.measure(block.register, values, self._draws(block))
        layer.ownership.remove(block)
        chance = Chance(layer.draws, block.name, f"detectors of {node}", size)
        found = layer.devices.detectors(node, "measure").detect(
            bits, block.pulses.extras, _train(block), chance
        )
        told = f"{tally(values, BASES)}: {tally(found.bits, ('0', '1'))}"
        layer.record(node, "measure", block, detail=told + _listed(found.incidents()))
        feedback.clicks, feedback.outcomes = found.clicks, found.bits.tobytes()
        return feedback

    def bell_measure(self, node: str, names: tuple[BlockName, BlockName]) -> Feedback:
        """Measure and use up pairs of photons, in the Bell basis."""
        layer = self._layer
        first, second = pair = self._pair(node, names)
        for block in pair:
            layer.take_up(block)
        halves = _half(first), _half(second)
        states = layer.sabot.bell_measure(
            first.register, second.register, (self._draws(first), self._draws(second))
        )
        drift.twirl_pairs(first, second, states, layer.draws)
        chance = Chance(layer.draws, first.name, f"analyser of {node}", len(states))
        found = self._analyser(node).analyse(states, halves, chance)
        for block in pair:
            layer.ownership.remove(block)
        feedback = layer.feedback(first)
        feedback.first_ns = min(first.first_ns, second.first_ns)
        feedback.last_ns = max(first.last_ns, second.last_ns)
        feedback.exact = first.pulses.exact and second.pulses.exact
        feedback.clicks = found.clicks
        feedback.coincidences = int(np.count_nonzero(found.outcomes != NO_CLICK))
        told = f"with {second.name.number}/{second.name.half}: {tally(found.outcomes, BELL_STATES)}"
        layer.record(node, "bell-measure", first, detail=told + _listed(found.incidents))
        feedback.outcomes = found.outcomes.tobytes()
        return feedback

    def store(self, node: str, name: BlockName) -> Feedback:
        """Keep a block in the node's memory."""
        block = self._layer.ownership.require(name, node)
        self._layer.memories.store(block)
        self._layer.record(node, "store", block)
        return self._layer.feedback(block)

    def discard(self, node: str, name: BlockName) -> Feedback:
        """Discard a block, also one that waits at a port of the node."""
        ownership = self._layer.ownership
        waiting = [block for block in ownership.parts(name) if block.node == node]
        return self._discard(waiting or [ownership.require(name, node)])

    def discard_session(self, node: str, session: int) -> Feedback:
        """Discard everything of a session at the node and at its ports, now and later."""
        self._layer.ownership.close(node, session)
        return self._discard(self._layer.ownership.of_session(node, session))

    def _discard(self, blocks: list[Block]) -> Feedback:
        for block in blocks:
            self._layer.drop(block)
            self._layer.record(block.node, "discard", block, port=block.port)
        photons = sum(block.register.size for block in blocks)
        return Feedback(time_ns=self._layer.clock.now_ns(), photons=photons)

    def _pair(self, node: str, names: tuple[BlockName, BlockName]) -> tuple[Block, Block]:
        first, second = (self._layer.ownership.require(name, node) for name in names)
        _require_pairs(first, second)
        return first, second

    def _analyser(self, node: str) -> Analyser:
        devices = self._layer.devices
        arms = devices.detectors(node, "phase"), devices.detectors(node, "parity")
        return Analyser(devices.of(node), arms)

    def _twirl(self, gate: str, block: Block, target: Block | None) -> None:
        """Turn angles into Paulis before a gate that does not commute with them."""
        if gate in COMMUTE_WITH_Z:
            return
        if gate != "CX":
            drift.twirl(block, self._layer.sabot, self._layer.draws)
        elif target is not None:
            drift.twirl(target, self._layer.sabot, self._layer.draws)

    def _draws(self, block: Block) -> PhotonDraws:
        return self._layer.draws.photons(block.name, "measure", block.register.size)

    def _require_room(self, names: list[BlockName], count: int) -> None:
        """Refuse a block that would be too large or has a name that is taken."""
        layer = self._layer
        limits.require_count(count)
        for name in names:
            if layer.ownership.exists(name):
                message = f"{name} exists; discard it or take another number"
                raise Refusal(grpc.StatusCode.ALREADY_EXISTS, message)
        live, more = layer.sabot.live_qubits, count * len(names)
        if live + more > layer.max_live_qubits:
            raise exhausted(
                f"{more} more qubits with {live} live exceed the limit of "
                f"{layer.max_live_qubits}; measure or discard some first"
            )
        if layer.ownership.count + len(names) > limits.MAX_BLOCKS:
            raise exhausted(
                f"{limits.MAX_BLOCKS} blocks are live; use larger blocks or discard some"
            )

    def _plan(self, node: str, block: Block, gates: Sequence[Gate]) -> list[PlannedGate]:
        """Look up everything that gates need, so that none fails halfway."""
        if len(gates) > limits.MAX_GATES:
            raise invalid(f"{len(gates)} gates; send at most {limits.MAX_GATES} in a request")
        return [self._plan_gate(node, block, gate) for gate in gates]

    def _plan_gate(self, node: str, block: Block, gate: Gate) -> PlannedGate:
        if gate.name not in GATES:
            raise invalid(f"gate {gate.name} is unknown; use {', '.join(GATES.values())}")
        if gate.name not in (Gate.CX, Gate.CZ):
            return GATES[gate.name], None
        target = self._layer.ownership.require(block_name(gate.target), node)
        _require_pairs(block, target)
        return GATES[gate.name], target


def _require_pairs(first: Block, second: Block) -> None:
    if first is second:
        raise invalid(f"{first.name} is named twice; name two different blocks")
    if first.register.size != second.register.size:
        raise invalid(
            f"{first.name} has {first.register.size} photons and {second.name} "
            f"{second.register.size}; their photons must pair up"
        )


def _train(block: Block) -> Train:
    return Train(block.start_ns, block.interval_ns, block.register.size)


def _half(block: Block) -> Half:
    pulses = block.pulses
    return Half(block.register.present, pulses.extras, pulses.delays_ps, _train(block))


def _listed(incidents: dict[str, int]) -> str:
    if not incidents:
        return ""
    return "; " + " ".join(f"{name}={count}" for name, count in incidents.items())
