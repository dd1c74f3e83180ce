"""The experiments that there are, by name."""

import asyncio

from evidence.curves.bell_measurements import CHSH, DELAY_LINE
from evidence.curves.classical_light import CLASSICAL_LIGHT
from evidence.curves.conference import CONFERENCE, FAR_CONFERENCE
from evidence.curves.contention import LIGHT
from evidence.curves.cutoff import CUTOFF_TIMES
from evidence.curves.decoy_states import DECOY_STATES
from evidence.curves.detectors import DEAD, FRESH_OUTCOMES
from evidence.curves.experiment import Experiment, Outcome
from evidence.curves.gated_bell import GATED_BELL
from evidence.curves.gated_swap import GATED_SWAP
from evidence.curves.ghz import GHZ
from evidence.curves.graph_states import GRAPH
from evidence.curves.handed_over import HANDED_OVER
from evidence.curves.heralding import HERALDING
from evidence.curves.interference import HOM
from evidence.curves.light_sources import LIGHT_SOURCES
from evidence.curves.links import CHAIN_OF_LINKS, SEVERAL_FIBERS
from evidence.curves.memory_heralds import MEMORY_HERALDS
from evidence.curves.multi_pair import MULTI_PAIR
from evidence.curves.nested import NESTED
from evidence.curves.pair_keys import PAIR_KEYS
from evidence.curves.pairs_made import PAIRS_MADE
from evidence.curves.parameters import Values, point_seed
from evidence.curves.photon_splitting import PHOTON_SPLITTING
from evidence.curves.polarization import MODES, POLARIZATION
from evidence.curves.purification import PURIFICATION
from evidence.curves.relayed_keys import RELAYED_KEYS
from evidence.curves.relayed_pairs import RELAYED_PAIRS
from evidence.curves.scheduling import SCHEDULE
from evidence.curves.seal import SEAL
from evidence.curves.sensing import SENSING
from evidence.curves.spied_pairs import SPIED_PAIRS
from evidence.curves.superdense import SUPERDENSE
from evidence.curves.teleportation import SWAP, TELEPORT
from evidence.curves.timing import TIMING
from evidence.curves.waiting import WAITING
from evidence.curves.weak_pulses import WEAK_PULSES

EXPERIMENTS: dict[str, Experiment] = {
    each.name: each
    for each in (
        SUPERDENSE,
        TELEPORT,
        SWAP,
        CHSH,
        SPIED_PAIRS,
        HOM,
        DEAD,
        GATED_BELL,
        GATED_SWAP,
        PURIFICATION,
        NESTED,
        WAITING,
        HANDED_OVER,
        PAIRS_MADE,
        MEMORY_HERALDS,
        FRESH_OUTCOMES,
        MULTI_PAIR,
        WEAK_PULSES,
        LIGHT_SOURCES,
        CLASSICAL_LIGHT,
        PAIR_KEYS,
        RELAYED_KEYS,
        RELAYED_PAIRS,
        DECOY_STATES,
        PHOTON_SPLITTING,
        POLARIZATION,
        MODES,
        TIMING,
        DELAY_LINE,
        GHZ,
        GRAPH,
        CONFERENCE,
        FAR_CONFERENCE,
        HERALDING,
        CUTOFF_TIMES,
        LIGHT,
        CHAIN_OF_LINKS,
        SEVERAL_FIBERS,
        SCHEDULE,
        SEAL,
        SENSING,
    )
}


def measure(name: str, values: Values, seed: int) -> dict[str, tuple[float, float]]:
    """Run an experiment at one point; return value and standard error of each measure.

    Outcomes depend on the experiment, the values and the seed alone: not
    on the machine, nor on which points were measured before. This is what workers are asked.
    """
    run = EXPERIMENTS[name].run
    assert run is not None  # all of these can
    outcome: Outcome = asyncio.run(run(values, point_seed(name, values, seed)))
    return {key: (estimate.value, estimate.error) for key, estimate in outcome.items()}
