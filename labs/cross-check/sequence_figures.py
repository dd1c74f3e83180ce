"""Figures of SeQUeNCe for figures.json, in an environment of its own (README.md says how).

Each is what its BBPSSW protocol makes of two Bell-diagonal pairs: F afterwards, how likely it is.
"""

import json
from importlib.metadata import version
from itertools import product

from sequence.components.memory import Memory
from sequence.constants import BELL_DIAGONAL_STATE_FORMALISM
from sequence.entanglement_management.purification.bbpssw_bds import BBPSSW_BDS
from sequence.kernel.quantum_manager import QuantumManager
from sequence.kernel.timeline import Timeline
from sequence.topology.node import Node

FIDELITIES, GATES, READOUTS = (0.8, 0.9), (1.0, 0.96), (1.0, 0.98)


def purified(fidelity: float, gate: float, readout: float) -> dict[str, str | float]:
    """Return the outcome of two Werner pairs, by noisy gates and readings at both ends."""
    QuantumManager.set_global_manager_formalism(BELL_DIAGONAL_STATE_FORMALISM)
    timeline = Timeline()
    ends = [Node(name, timeline) for name in ("alice", "bob")]
    for end in ends:
        end.gate_fid, end.meas_fid = gate, readout
    hers = []
    for role in ("kept", "measured"):
        pair = [Memory(f"{end.name}.{role}", timeline, fidelity, 0, 1, -1, 500) for end in ends]
        state = [fidelity] + [(1 - fidelity) / 3] * 3
        timeline.quantum_manager.set([memory.qstate_key for memory in pair], state)
        hers.append(pair[0])
    protocol = BBPSSW_BDS(ends[0], "bbpssw", *hers, is_twirled=True)
    protocol.remote_node_name = "bob"
    success, state = protocol.purification_res()
    point = {"fidelity": fidelity, "gate": gate, "readout": readout}
    name = f"F-{fidelity:g}-gate-{gate:g}-readout-{readout:g}"
    return {"name": name, **point, "purified": float(state[0]), "success": float(success)}


if __name__ == "__main__":
    found = [purified(*point) for point in product(FIDELITIES, GATES, READOUTS)]
    print(json.dumps({"program": f"sequence {version('sequence')}", "figures": found}, indent=1))
