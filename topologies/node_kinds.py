"""Kinds of nodes by what they are made of: what the device of a host of each kind is like.

qmn run distribute --node ion-trap --source alice --count 20
sudo PYTHONPATH=. mn --custom topologies/repeaters.py --topo repeaters,node=ion-trap

The controller does not know them: it goes by the features that follow from a device
(wire.features).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from wire.parameters.physics import BadParameter, BellAnalyser, Device, Gates, Memory, PairSource

# Ions in a trap that emit photons and take in their state, keep qubits, and do gates on them.
# Source: entanglement of two ions over fibres with fidelity .960(1), and with 250 pairs a second,
# in two experiments that arXiv:2406.01761 and doi 10.1038/s41467-025-57557-4 quote; a pulse here is
# a pair that has been heralded. Memory: an entangled ion of fidelity .81(4) after 10 s
# (arXiv:2210.11447), of which T2 = 30 s is our estimate; registers of ten ions, each entangled with
# a photon, are shown in arXiv:2406.09480, 32 of them are our estimate for a few zones of a trap.
# Gates: errors of two-qubit gates on 43Ca+ of .5(1) % (arXiv:2402.12955), of one-qubit gates of
# 8.4e-6 (arXiv:2407.07694). Preparation and measurement without errors are our idealisation.
ION_TRAP = Device(
    source=PairSource(fidelity=0.96, max_rate_hz=250.0),
    memory=Memory(t1_s=1e6, t2_s=30.0, capacity=32),
    analyser=BellAnalyser("gates"),
    gates=Gates("any", 2 * 8.4e-6, 0.005 * 4 / 3),
)


@dataclass(frozen=True)
class NodeKind:
    """What hosts of a kind are like, made of what a preset says of every host."""

    help: str
    of: Callable[[Device], Device]


NODE_KINDS = {
    "photonic": NodeKind(
        "light alone: modulators do Pauli operators, and photons do not meet in gates",
        lambda base: replace(base, gates=replace(base.gates, kind="paulis")),
    ),
    "ion-trap": NodeKind(
        "memory of 32 ions, gates between them, 250 pairs a second", lambda _base: ION_TRAP
    ),
}


def node_device(kind: str, base: Device) -> Device:
    """Return the device of a host of a kind; raise BadParameter with the kinds there are."""
    if kind not in NODE_KINDS:
        raise BadParameter(f"node {kind!r} is unknown; choose {', '.join(NODE_KINDS)}")
    return NODE_KINDS[kind].of(base)
