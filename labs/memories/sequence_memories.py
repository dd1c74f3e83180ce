"""Fidelities of waiting pairs in SeQUeNCe for sequence_memories.json, in an environment of its own.

README.md says how. Each is what its memories make of a Werner pair that both keep for so long.
"""

import json
from importlib.metadata import version

from sequence.components.memory import Memory
from sequence.constants import BELL_DIAGONAL_STATE_FORMALISM
from sequence.kernel.quantum_manager import QuantumManager
from sequence.kernel.timeline import Timeline

FIDELITY, COHERENCE_S, STEPS, STEP_S = 0.9, 1.0, 80, 0.025
ERRORS = {"dephasing": [0.0, 0.0, 1.0], "depolarizing": [1 / 3, 1 / 3, 1 / 3]}  # X, Y, Z
BEGUN_PS, S = 1, 10**12  # at time 0 it takes memories for empty


def fidelities(errors: list[float]) -> list[float]:
    QuantumManager.set_global_manager_formalism(BELL_DIAGONAL_STATE_FORMALISM)
    timeline, values = Timeline(), [FIDELITY]
    pair = [
        Memory(name, timeline, FIDELITY, 0, 1, COHERENCE_S, 500, errors)
        for name in ("alice", "bob")
    ]
    state = [FIDELITY] + [(1 - FIDELITY) / 3] * 3
    timeline.quantum_manager.set([memory.qstate_key for memory in pair], state)
    for memory in pair:
        memory.last_update_time = BEGUN_PS
    for step in range(1, STEPS + 1):
        timeline.time = BEGUN_PS + round(step * STEP_S * S)
        for memory in pair:
            memory.bds_decohere()
        values.append(float(timeline.quantum_manager.states[pair[0].qstate_key].state[0]))
    return values


if __name__ == "__main__":
    results = {name: fidelities(errors) for name, errors in ERRORS.items()}
    given = {"fidelity": FIDELITY, "step": STEP_S / COHERENCE_S}
    print(json.dumps({"program": f"sequence {version('sequence')}", **given, **results}, indent=1))
