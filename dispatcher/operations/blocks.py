"""Operations of a node on blocks that it holds: each checks, then acts, then records."""

from collections.abc import Sequence
from typing import NamedTuple

import grpc
import numpy as np

from dispatcher.approximations import SEVERAL_IN_GATES, approximation
from dispatcher.devices import hardware
from dispatcher.devices.source import most_extra_pairs
from dispatcher.layer import cutoff, device_noise, drift, extra_pairs, herald
from dispatcher.layer.layer import PhysicalLayer, block_name, tally
from dispatcher.layer.ownership import Block, BlockName
from dispatcher.layer.weak_pulses import ArrayChoices, Choices
from dispatcher.operations import emission, imperfections, limits, weak_light
from dispatcher.operations.emission import emit_into, emit_prepared
from dispatcher.refusal import Refusal, exhausted, invalid
from dispatcher.sabot.backend import Angle, Bytes, GateName
from dispatcher.sabot.capacity import GateStep
from dispatcher.sabot.gates import ROTATIONS, TWO_QUBIT_GATES
from dispatcher.sabot.limits import MAX_GATES, require_count
from dispatcher.sabot.registers import Register
from wire import dibits
from wire.dispatcher_pb2 import (
    ApplyRequest,
    BlockId,
    CreateRequest,
    Feedback,
    Gate,
    StoreRequest,
)
from wire.features import EMIT, GATE, STORE
from wire.keyed import KeyedChoices
from wire.outcomes import PAULIS
from wire.parameters.physics import PairSource

DIAGONAL = ("S", "S_DAG", "CZ", "T", "T_DAG", "RZ")
GATES: dict[int, GateName] = {
    Gate.H: "H",
    Gate.S: "S",
    Gate.S_DAG: "S_DAG",
    Gate.CX: "CX",
    Gate.CZ: "CZ",
    Gate.T: "T",
    Gate.T_DAG: "T_DAG",
    Gate.RX: "RX",
    Gate.RY: "RY",
    Gate.RZ: "RZ",
}
PAIR = 2
STATES = {
    CreateRequest.BELL_PAIRS: ("Bell pairs", PAIR),
    CreateRequest.ZEROS: ("zeros", 1),
    CreateRequest.PREPARED: ("prepared", 1),
}
STATE_NAMES = [CreateRequest.State.Name(state) for state in STATES]


class PlannedGate(NamedTuple):
    """A valid gate: no photon of a pair is lost, and its angle is a number."""

    name: GateName
    target: Block | None = None
    angle_rad: Angle = 0.0

    @property
    def step(self) -> GateStep:
        target = self.target.register if self.target else None
        return GateStep(self.name, target, self.angle_rad)

    @property
    def detail(self) -> str:
        if self.name not in ROTATIONS:
            return self.name
        one_each = isinstance(self.angle_rad, np.ndarray)
        return f"{self.name}({'each its own' if one_each else format(self.angle_rad, 'g')})"

    def turned(self, block: Block) -> list[Block]:
        """Return the blocks whose Z the gate does not commute with."""
        if self.name in DIAGONAL:
            return []
        return [block] if self.target is None else [self.target]

    def spread_approximation(self, block: Block) -> None:
        """Let an approximation in one of the two blocks be in both."""
        if self.target is not None:
            both = block.pulses.approximations | self.target.pulses.approximations
            if block.extra_pairs is not None or self.target.extra_pairs is not None:
                several = max(extra_pairs.share(block), extra_pairs.share(self.target))
                both |= approximation(SEVERAL_IN_GATES, several)
            block.pulses.approximations = self.target.pulses.approximations = both


class Operations:
    def __init__(self, layer: PhysicalLayer) -> None:
        self._layer = layer
        self.pairs_created = 0

    def create(self, node: str, request: CreateRequest) -> Feedback:
        layer = self._layer
        if request.state not in STATES:
            raise invalid(f"state {request.state} is unknown; use {', '.join(STATE_NAMES)}")
        text, halves = STATES[request.state]
        # Photons that leave are of a source; qubits that stay may be ions, too.
        makers = (EMIT,) if halves == PAIR else (EMIT, STORE)
        hardware.require(layer.devices, node, *makers)
        names = [BlockName(request.session, request.number, half) for half in range(halves)]
        source = layer.devices.of(node).source
        by_host = request.state == CreateRequest.ZEROS  # qubits of its own, not of its source
        choices = limits.choices(request, len(source.intensities))
        weak = weak_light.is_weak(source) and not _has_custom_noise(layer, node)
        if choices is not None and weak:
            return self._create_weak(node, names[0], source, choices)
        if halves == PAIR and source.statistics == "poisson" and not _has_custom_noise(layer, node):
            return self._create_weak_pairs(node, names, source, request.count)
        require_count(request.count)
        states, levels = self._states(request, choices, source)
        if states is not None and weak:
            return self._create_weak(node, names[0], source, ArrayChoices(states, levels))
        more = 0 if by_host else most_extra_pairs(source, request.count)
        self._require_capacity(node, names, request.count, more)
        blocks = self._new_blocks(node, names, self._make(request, states))
        text += self._emit(blocks, states, levels)
        if not by_host:
            self._custom_noise_of_source(blocks)
        seconds = layer.devices.of(node).gates.initialization_s if by_host else 0.0
        if states is not None:
            text += f": {tally(states, emission.STATES)}"
        each = None if states is None else lambda position: emission.STATES[states[position]]
        layer.record(node, "create", blocks[0], detail=text, each=each)
        return imperfections.lasts(layer.feedback(blocks[0]), seconds, blocks)

    def _emit(self, blocks: list[Block], states: Bytes | None, levels: Bytes | None) -> str:
        """Let a source emit pairs or prepared photons, or a host hold qubits; say how many."""
        if len(blocks) == PAIR:
            pairs, detail = emit_into(blocks[0], blocks[1], self._layer)
            self.pairs_created += pairs
            return detail
        if states is not None:
            return emit_prepared(blocks[0], states, levels, self._layer)
        blocks[0].kept = blocks[0].retimed = True
        wrong = imperfections.misprepared(self._layer, blocks[0])
        return f", in |1> {wrong}" if wrong else ""

    def _states(
        self, request: CreateRequest, choices: KeyedChoices | None, source: PairSource
    ) -> tuple[Bytes | None, Bytes | None]:
        """Return the state and the level of each photon; None: what all have."""
        if choices is None:
            return limits.states(request), limits.levels(request, len(source.intensities))
        every = np.arange(request.count)
        return choices.states(every), choices.levels(every)

    def _create_weak(
        self, node: str, name: BlockName, source: PairSource, choices: Choices
    ) -> Feedback:
        """Let a laser emit pulses, whose photons are drawn when something looks at them."""
        layer = self._layer
        self._require_capacity(node, [name], choices.places, 0)
        (block,) = self._new_blocks(node, [name], [Register(0)])
        light = weak_light.emitted(block, source, choices, layer.draws)
        layer.ownership.change(block, Register(0), light)
        block.retimed, block.source_rate_hz = True, source.max_rate_hz
        detail = "weak pulses, by a key"
        if isinstance(choices, ArrayChoices):
            detail = f"weak pulses: {tally(choices.each_state, emission.STATES)}"

        def each(position: int) -> str:
            return emission.STATES[choices.states(np.array([position]))[0]]

        layer.record(node, "create", block, detail=detail, each=each)
        return layer.feedback(block)

    def _create_weak_pairs(
        self, node: str, names: list[BlockName], source: PairSource, count: int
    ) -> Feedback:
        """Let a source emit pairs, which are drawn when something looks at either half."""
        layer = self._layer
        if not count:
            raise invalid("count is 0; name the pulses to be made")
        self._require_capacity(node, names, 0, 0)
        blocks = self._new_blocks(node, names, [Register(0), Register(0)])
        pairs = weak_light.emitted_pairs(layer, blocks, source, count)
        self.pairs_created += pairs
        layer.record(node, "create", blocks[0], detail=f"Bell pairs, {pairs} in weak pulses")
        return layer.feedback(blocks[0])

    def _new_blocks(
        self, node: str, names: Sequence[BlockName], registers: Sequence[Register]
    ) -> list[Block]:
        layer = self._layer
        lineage = layer.ownership.used_names.use(names[0].session, names[0].number)
        source, now_ns = layer.devices.of(node).source, layer.clock.now_ns()
        blocks = [
            Block(name, register, node, first_ns=now_ns, last_ns=now_ns, start_ns=now_ns)
            for name, register in zip(names, registers, strict=True)
        ]
        for block in blocks:
            block.lineage = lineage
            block.pulses.encoding, block.pulses.bandwidth_nm = source.encoding, source.bandwidth_nm
            layer.ownership.add(block)
        return blocks

    def _custom_noise_of_source(self, blocks: Sequence[Block]) -> None:
        """Let a model of the user's own say what is wrong with new pairs, at half 0, or photons."""
        layer, first = self._layer, blocks[0]
        model = layer.devices.noise(first.node, "source")
        if model is None:
            return
        effect = device_noise.effect_of(model, layer.draws, first, "source", "made", first.start_ns)
        layer.photons_lost += device_noise.meet(layer.sabot, layer.draws, first, effect, "made")
        lost = effect._replace(paulis=None, kraus=None)
        for other in blocks[1:]:
            other.pulses.approximations |= effect.approximations
            layer.photons_lost += device_noise.meet(layer.sabot, layer.draws, other, lost, "made")

    def _make(self, request: CreateRequest, states: Bytes | None) -> Sequence[Register]:
        sabot = self._layer.sabot
        if states is not None:
            return [emission.prepare(sabot, states)]
        if request.state == CreateRequest.ZEROS:
            return [sabot.zeros(request.count)]
        return sabot.bell_pairs(request.count)

    def apply(self, node: str, request: ApplyRequest) -> Feedback:
        """Apply a Pauli to each photon, then gates to all of them."""
        layer, name = self._layer, block_name(request.block)
        block = layer.ownership.require(name, node)
        if not request.gates and weak_light.takes_paulis(layer, block):
            packed = limits.packed_paulis(request, block.size)
            if packed:
                return self._apply_weak(node, block, packed)
        weak_light.draw(layer, f"an operation of {node}", block)
        planned = self._plan(node, block, request.gates)
        if planned:
            hardware.require(layer.devices, node, GATE)
        details = [gate.detail for gate in planned]
        values = limits.paulis(request, block.register.size)
        errors = 0
        layer.sabot.require_capacity(block.register, [gate.step for gate in planned])
        done_ns = layer.clock.now_ns()  # however long it takes to simulate
        targets = [gate.target for gate in planned if gate.target is not None]
        layer.take_up(block, *targets, made=True)
        if values is not None:
            _let_by(layer, block, values)
            extra_pairs.pauli(layer.sabot, block, values)
            drift.reflect(block.pulses, values)
            details.insert(0, tally(values, PAULIS))
            errors = imperfections.after_gate(layer, block, values != imperfections.IDENTITY)
        errors += sum(_apply_gate(layer, block, gate) for gate in planned)
        if errors:
            details.append(f"gate-errors={errors}")
        each = None if values is None else lambda position: PAULIS[values[position]]
        layer.record(node, "apply", block, detail=" ".join(details), each=each)
        feedback = layer.feedback(block)
        feedback.time_ns = done_ns
        others = [gate.target for gate in planned if gate.target is not None]
        if not all(each.kept for each in (block, *others)):
            return feedback
        singles = len(planned) - len(others) + int(values is not None and bool(values.any()))
        seconds = imperfections.of_gates(layer.devices.of(node).gates, singles, len(others))
        return imperfections.lasts(feedback, seconds, [block, *others])

    def _apply_weak(self, node: str, block: Block, packed: bytes) -> Feedback:
        """Let weak pulses carry Paulis, which photons meet that are drawn."""
        weak_light.apply(self._layer, block, packed)
        counts = dibits.counts(packed)
        counts[0] -= dibits.PER_BYTE * len(packed) - block.size
        detail = " ".join(
            f"{name}={count}" for name, count in zip(PAULIS, counts, strict=True) if count
        )

        def each(position: int) -> str:
            return PAULIS[int(dibits.at(packed, np.array([position]), "little")[0])]

        self._layer.record(node, "apply", block, detail=detail, each=each)
        return self._layer.feedback(block)

    def store(self, node: str, request: StoreRequest) -> Feedback:
        """Keep a block in the node's memory, and drop what is older than the cut-off."""
        cutoff_s = cutoff.requested(request)
        block = weak_light.require(self._layer, block_name(request.block), node)
        wrong, _old = self._layer.memories.store(block, cutoff_s)
        self._layer.record(node, "store", block, detail=wrong)
        feedback = self._layer.feedback(block)
        feedback.time_ns = block.stored_ns
        feedback.arrived = herald.heralded(block).astype(np.uint8).tobytes()
        return feedback

    def discard(self, node: str, block: BlockId) -> Feedback:
        """Discard a block, also one that waits at a port of the node."""
        ownership, name = self._layer.ownership, block_name(block)
        waiting = [block for block in ownership.parts(name) if block.node == node]
        return self._discard(waiting or [ownership.require(name, node)])

    def discard_session(self, node: str, session: int) -> Feedback:
        """Discard everything of a session at the node and at its ports, now and later."""
        self._layer.ownership.close(node, session)
        return self._discard(self._layer.ownership.of_session(node, session))

    def _discard(self, blocks: list[Block]) -> Feedback:
        photons = sum(block.size for block in blocks)
        feedback = Feedback(time_ns=self._layer.clock.now_ns(), photons=photons)
        self._layer.mark(feedback, blocks)
        for block in blocks:
            self._layer.drop(block)
            self._layer.record(block.node, "discard", block, port=block.port)
        return feedback

    def _require_capacity(
        self, node: str, names: list[BlockName], count: int, extra_pairs: int
    ) -> None:
        """Refuse a block that may be too large, with its further pairs, or whose name is taken."""
        layer = self._layer
        for name in names:
            if layer.ownership.taken(name, node):
                message = f"{name} exists; discard it or take another number"
                raise Refusal(grpc.StatusCode.ALREADY_EXISTS, message)
        live, more = layer.sabot.live_qubits, (count + extra_pairs) * len(names)
        if live + more > layer.max_live_qubits:
            raise exhausted(
                f"{more} more qubits with {live} live exceed the limit of "
                f"{layer.max_live_qubits}; measure or discard some first"
            )
        places = layer.ownership.makers.places_of(node)
        if places + more > layer.share:
            raise exhausted(
                f"{more} more qubits with {places} that {node} has made and that are live "
                f"exceed its share of {layer.share}; measure or discard some first"
            )
        limits.require_blocks(layer, len(names), node)

    def _plan(self, node: str, block: Block, gates: Sequence[Gate]) -> list[PlannedGate]:
        """Look up everything that gates need, so that none fails halfway."""
        if len(gates) > MAX_GATES:
            raise invalid(f"{len(gates)} gates; send at most {MAX_GATES} in a request")
        return [self._plan_gate(node, block, gate) for gate in gates]

    def _plan_gate(self, node: str, block: Block, gate: Gate) -> PlannedGate:
        if gate.name not in GATES:
            raise invalid(f"gate {gate.name} is unknown; use {', '.join(GATES.values())}")
        name = GATES[gate.name]
        angle = limits.angle(name, gate, block.register.size, self._layer.sabot.backend)
        if name not in TWO_QUBIT_GATES:
            return PlannedGate(name, None, angle)
        target = weak_light.require(self._layer, block_name(gate.target), node)
        require_pairs(block, target)
        return PlannedGate(name, target)


def _has_custom_noise(layer: PhysicalLayer, node: str) -> bool:
    return layer.devices.noise(node, "source") is not None


def _apply_gate(layer: PhysicalLayer, block: Block, gate: PlannedGate) -> int:
    for affected in (block, gate.target):
        if affected is not None:
            drift.twirl_turn(affected, layer.sabot, layer.draws)
    for turned in gate.turned(block):
        drift.twirl(turned, layer.sabot, layer.draws)
    layer.sabot.gate(gate.name, block.register, gate.step.target, gate.angle_rad)
    gate.spread_approximation(block)
    if gate.target is not None:
        return imperfections.after_pair_gate(layer, block, gate.target)
    extra_pairs.gate(layer.sabot, block, gate.name, gate.angle_rad)
    return imperfections.after_gate(layer, block)


def _let_by(layer: PhysicalLayer, block: Block, paulis: Bytes) -> None:
    """Bring Paulis in before the turns of a block: these follow one that is the same for all."""
    turn = block.pulses.turn
    if turn is not None and (paulis == paulis[0]).all():
        block.pulses.turn = turn.behind(int(paulis[0]))
    else:
        drift.twirl_turn(block, layer.sabot, layer.draws)


def require_pairs(first: Block, second: Block) -> None:
    if first is second:
        raise invalid(f"{first.name} is named twice; name two different blocks")
    if first.register.size != second.register.size:
        raise invalid(
            f"{first.name} has {first.register.size} photons and {second.name} "
            f"{second.register.size}; their photons must pair up"
        )
