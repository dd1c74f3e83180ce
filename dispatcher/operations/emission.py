"""Makes new Bell pairs, and photons in given states, what the source of their host emits."""

import numpy as np

from dispatcher.devices.source import Emission, bell_states, emit, misprepared
from dispatcher.layer import extra_pairs
from dispatcher.layer.extra_pairs import owners
from dispatcher.layer.layer import PhysicalLayer, tally
from dispatcher.layer.ownership import Block, ExtraPairs
from dispatcher.photon_random import PhotonRandom
from dispatcher.sabot.backend import Bytes
from dispatcher.sabot.registers import Mask, Register
from dispatcher.sabot.simulation import Simulation
from wire.outcomes import BELL_STATES
from wire.parameters.physics import PairSource

STATES = ("|0>", "|1>", "|+>", "|->", "|+i>", "|-i>")
Z, X, Y = range(3)  # half of a state's number is its basis, the rest its sign


def prepare(sabot: Simulation, states: Bytes) -> Register:
    """Return qubits in these states, numbered as in STATES; shape (k,)."""
    register = sabot.zeros(states.size)
    turn(sabot, register, states)
    return register


def turn(sabot: Simulation, register: Register, states: Bytes) -> None:
    """Bring qubits from |0> into these states; shape (k,)."""
    signs, bases = states & np.uint8(1), states >> np.uint8(1)
    if signs.any():
        sabot.pauli(register, signs)
    for basis in (X, Y):
        same = bases == basis
        if same.any():
            _turn(sabot, register, basis, same)


def _turn(sabot: Simulation, register: Register, basis: int, members: Mask) -> None:
    turned = register if members.all() else sabot.part(register, members)
    sabot.gate("H", turned)
    if basis == Y:
        sabot.gate("S", turned)
    if turned is not register:
        sabot.unite(register, turned)


PAIRS = ("none", "1", "2", "more")


def emit_into(first: Block, second: Block, layer: PhysicalLayer) -> tuple[int, str]:
    """Let the halves of new blocks be what a source emits; return the pairs, and a description."""
    source = layer.devices.of(first.node).source
    count = first.register.size
    emission = emit(source, PhotonRandom(layer.draws, first.name, first.draws_for("source"), count))
    detail = ""
    if emission.paulis is not None:
        layer.sabot.pauli(first.register, emission.paulis)
        detail += f", {tally(emission.paulis, BELL_STATES)}"
    more = None if emission.pairs is None else _extra_pairs_pairs(emission, source, first, layer)
    for number, half in enumerate((first, second)):
        half.source_rate_hz = source.max_rate_hz
        half.pulses.approximations = emission.approximations
        half.pulses.delays_ps = emission.delays_ps
        if emission.pairs is not None:
            layer.sabot.lose(half.register, emission.pairs == 0)
            half.extra_pairs = None if more is None else more[number]
    if emission.pairs is None:
        return count, detail
    detail += f", pairs in pulses: {_numbers_text(emission.pairs)}"
    return int(emission.pairs.sum(dtype=np.int64)), detail


def emit_prepared(block: Block, states: Bytes, levels: Bytes | None, layer: PhysicalLayer) -> str:
    """Let new photons in given states be what a source emits; return a description.

    All photons of a pulse are in the same state; levels choose its intensity. A host without a
    source keeps what it prepares.
    """
    source = layer.devices.of(block.node).source
    if source.statistics == "none":
        return ""
    block.retimed = True
    random = PhotonRandom(layer.draws, block.name, block.draws_for("source"), block.register.size)
    emission = emit(source, random, levels, prepared=True)
    block.pulses.delays_ps = emission.delays_ps
    detail = "" if emission.pairs is None else _emit_photons(block, states, emission.pairs, layer)
    paulis = misprepared(source, random)
    if paulis is not None:
        extra_pairs.pauli(layer.sabot, block, paulis)
        detail += f", errors={np.count_nonzero(paulis)}"
    if emission.pairs is not None:
        block.source_rate_hz = source.max_rate_hz
    return detail


def _emit_photons(block: Block, states: Bytes, photons: Bytes, layer: PhysicalLayer) -> str:
    """Give pulses these numbers of photons; return a description."""
    layer.sabot.lose(block.register, photons == 0)
    at = owners(photons)
    if at.size:
        block.extra_pairs = ExtraPairs(prepare(layer.sabot, states[at]), at)
    return f", photons in pulses: {_numbers_text(photons)}"


def _extra_pairs_pairs(
    emission: Emission, source: PairSource, first: Block, layer: PhysicalLayer
) -> tuple[ExtraPairs, ExtraPairs] | None:
    assert emission.pairs is not None
    at = owners(emission.pairs)
    if not at.size:
        return None
    one, other = layer.sabot.bell_pairs(at.size)
    place = first.draws_for("source further")
    paulis = bell_states(source, PhotonRandom(layer.draws, first.name, place, at.size))
    if paulis is not None:
        layer.sabot.pauli(one, paulis)
    return ExtraPairs(one, at), ExtraPairs(other, at)


def _numbers_text(pairs: Bytes) -> str:
    return tally(np.minimum(pairs, len(PAIRS) - 1), PAIRS)
