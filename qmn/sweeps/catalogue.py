"""The experiments that there are, by name."""

import asyncio

from qmn.sweeps.bell_measurements import CHSH, DELAY_LINE
from qmn.sweeps.classical_light import CLASSICAL_LIGHT
from qmn.sweeps.conference import CONFERENCE, FAR_CONFERENCE
from qmn.sweeps.contention import LIGHT
from qmn.sweeps.cutoff import CUTOFF_TIMES
from qmn.sweeps.decoy_states import DECOY_STATES
from qmn.sweeps.detectors import DEAD, FRESH_OUTCOMES
from qmn.sweeps.experiment import Experiment, Outcome
from qmn.sweeps.gated_bell import GATED_BELL
from qmn.sweeps.gated_swap import GATED_SWAP
from qmn.sweeps.ghz import GHZ
from qmn.sweeps.graph_states import GRAPH
from qmn.sweeps.handed_over import HANDED_OVER
from qmn.sweeps.heralding import HERALDING
from qmn.sweeps.interference import HOM
from qmn.sweeps.light_sources import LIGHT_SOURCES
from qmn.sweeps.links import CHAIN_OF_LINKS, SEVERAL_FIBERS
from qmn.sweeps.memory_heralds import MEMORY_HERALDS
from qmn.sweeps.multi_pair import MULTI_PAIR
from qmn.sweeps.nested import NESTED
from qmn.sweeps.pair_keys import PAIR_KEYS
from qmn.sweeps.pairs_made import PAIRS_MADE
from qmn.sweeps.parameters import Values, point_seed
from qmn.sweeps.photon_splitting import PHOTON_SPLITTING
from qmn.sweeps.polarization import MODES, POLARIZATION
from qmn.sweeps.purification import PURIFICATION
from qmn.sweeps.relayed_keys import RELAYED_KEYS
from qmn.sweeps.relayed_pairs import RELAYED_PAIRS
from qmn.sweeps.scheduling import SCHEDULE
from qmn.sweeps.seal import SEAL
from qmn.sweeps.sensing import SENSING
from qmn.sweeps.spied_pairs import SPIED_PAIRS
from qmn.sweeps.superdense import SUPERDENSE
from qmn.sweeps.teleportation import SWAP, TELEPORT
from qmn.sweeps.timing import TIMING
from qmn.sweeps.waiting import WAITING
from qmn.sweeps.weak_pulses import WEAK_PULSES

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

    What happens depends on the experiment, the values and the seed, and on nothing else: not
    on the machine, nor on which points were measured before. This is what workers are asked.
    """
    run = EXPERIMENTS[name].run
    assert run is not None  # all of these can
    outcome: Outcome = asyncio.run(run(values, point_seed(name, values, seed)))
    return {key: (estimate.value, estimate.error) for key, estimate in outcome.items()}
