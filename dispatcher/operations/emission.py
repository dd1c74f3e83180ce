"""Makes new Bell pairs what the source of their host emits."""

import numpy as np

from dispatcher.devices.source import emit
from dispatcher.layer.layer import PhysicalLayer, tally
from dispatcher.layer.ownership import Block
from dispatcher.layer.pulses import further
from dispatcher.photon_random import PhotonRandom
from wire.physics import BELL_STATES

PAIRS = ("none", "1", "2", "more")


def emit_into(first: Block, second: Block, layer: PhysicalLayer) -> tuple[int, str]:
    """Let the halves of new blocks be what a source emits; return the pairs, and a description."""
    source = layer.devices.of(first.node).source
    count = first.register.size
    emission = emit(source, PhotonRandom(layer.draws, first.name, first.draws_for("source"), count))
    told = ""
    if emission.paulis is not None:
        layer.sabot.pauli(first.register, emission.paulis)
        told += f", {tally(emission.paulis, BELL_STATES)}"
    for half in (first, second):
        half.source_rate_hz = source.max_rate_hz
        half.pulses.exact = emission.exact
        half.pulses.delays_ps = emission.delays_ps
        if emission.pairs is not None:
            layer.sabot.lose(half.register, emission.pairs == 0)
            half.pulses.extras = further(emission.pairs)
    if emission.pairs is None:
        return count, told
    told += f", pairs in pulses: {tally(np.minimum(emission.pairs, len(PAIRS) - 1), PAIRS)}"
    return int(emission.pairs.sum(dtype=np.int64)), told
