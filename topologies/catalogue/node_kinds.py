"""Kinds of nodes by their hardware: the device of a host of each kind.

Values that no paper states are in docs/nodes.md ("Estimates").

qmn run distribute --node ion-trap --count 20
sudo PYTHONPATH=. mn --custom topologies/chain.py --topo chain,node=ion-trap

The controller does not know them: it goes by the features that follow from a device
(wire.features).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from wire.features import HERALD
from wire.parameters.checks import check_choice
from wire.parameters.physics import (
    BadParameter,
    BellAnalyser,
    Detectors,
    Device,
    Emitter,
    Gates,
    Memory,
    PairSource,
)
from wire.registered import Registry

# Ions in a trap that emit photons, keep qubits, and do gates on them. No source: what an ion emits
# is a pair with another ion only if a station heralds it, the slower the longer the fibres. Memory:
# an entangled ion of fidelity .81(4) after 10 s (arXiv:2210.11447); registers of ten ions, each
# entangled with a photon, are shown in arXiv:2406.09480. Emitter: entanglement of two ions by two
# clicks with fidelity .94, 182 times a second, of 2.18e-4 of the attempts (Stephenson et al., Phys.
# Rev. Lett. 124, 110501): from there follow the time of an attempt, 1.2 us, and the light of either
# ion that clicks, sqrt(2 x 2.18e-4), in which losses of detectors are. The fidelity of each ion and
# its photon is that of two alike which make .94. Gates: errors of two-qubit gates on 43Ca+ of .5(1)
# % (arXiv:2402.12955), of one-qubit gates of 8.4e-6 (arXiv:2407.07694), some 100 us and 10 us long
# (Ballance et al., Phys. Rev. Lett. 117, 060504; Harty et al., Phys. Rev. Lett. 113, 220501, with
# 6.8e-4 of preparation and readout, which are one error here). A readout takes 145 us (Myerson et
# al., Phys. Rev. Lett. 100, 200502).
ION_TRAP = Device(
    source=PairSource("none"),
    memory=Memory(t1_s=1e6, t2_s=30.0, kind="emissive", capacity=32),
    analyser=BellAnalyser("gates"),
    gates=Gates(
        "any",
        2 * 8.4e-6,
        0.005 * 4 / 3,
        one_qubit_s=10e-6,
        two_qubit_s=100e-6,
        readout_s=145e-6,
        readout_error=6.8e-4,
    ),
    emitter=Emitter("two-click", efficiency=0.0209, fidelity=0.97, preparation_s=1.2e-6),
)

# Nitrogen-vacancy centres in diamond, whose electron spins emit: up to 39 pairs a second by single
# clicks over 2 m, which decohere with 5 Hz (Humphreys et al., Nature 558, 268; arXiv:1712.07567).
# Attempts of 5.5 us, 4e-4 of the photons clicking, a visibility of .9 and an rms phase of 14.3
# degrees are of that experiment, too; phase_rad stands for both of the latter, half of them for
# either host. A bright state of .3 makes 2 x .3 x 4e-4 / 5.5 us = 44 a second.
# T2 = .4 s of either spin makes the 5 Hz. Ten qubits are those of the register of Bradley et al.,
# Phys. Rev. X 9, 031045. Gates on two spins of 500 us and on one nuclear spin of 20 us, a readout
# of 3.7 us that is wrong for |0> with .05 and for |1> with .005, of which this is the mean, and
# initialisation of a nuclear spin in 310 us are those of Dahlberg et al., arXiv:1903.09778.
NV_CENTRE = Device(
    source=PairSource("none"),
    memory=Memory(t1_s=3600.0, t2_s=0.4, kind="emissive", capacity=10),
    analyser=BellAnalyser("gates"),
    gates=Gates(
        "any",
        0.005,
        0.01,
        one_qubit_s=20e-6,
        two_qubit_s=500e-6,
        initialization_s=310e-6,
        readout_s=3.7e-6,
        readout_error=0.0275,
    ),
    emitter=Emitter(
        "single-click",
        efficiency=4e-4,
        bright_state=0.3,
        phase_rad=0.29,
        preparation_s=5.5e-6,
    ),
)

# Crystals that keep one photon of a pair, with 62 modes in time, for up to 25 us, while the other
# makes a click at the station, 1,400 times a second (Lago-Rivera et al., Nature 594, 37;
# arXiv:2101.05097).
ATOMIC_ENSEMBLE = Device(
    source=PairSource("none"),
    memory=Memory(t2_s=25e-6, efficiency=0.3, capacity=62),
    gates=Gates("paulis"),
    emitter=Emitter(
        "single-click", efficiency=0.014, bright_state=0.02, preparation_s=25e-6, modes=62
    ),
)

# A station that heralds, as a part of a switch: nothing but an analyser of linear optics, with
# detectors as good as those of superconducting nanowires. Its imperfections are in the click
# figures of the emitters above.
STATION = Device(
    source=PairSource("none"),
    memory=Memory(capacity=0),
    detectors=Detectors(dark_count_hz=10.0, gate_s=30e-9),
    analyser=BellAnalyser("linear"),
    gates=Gates("paulis"),
)


@dataclass(frozen=True)
class NodeKind:
    """A kind of host, made of the device that a preset gives every host."""

    help: str
    of: Callable[[Device], Device]


OWN = {
    "photonic": NodeKind(
        "light alone: modulators do Pauli operators, and photons do not meet in gates",
        lambda base: replace(base, gates=replace(base.gates, kind="paulis")),
    ),
    "ion-trap": NodeKind(
        "memory of 32 ions that emit, gates between them: two clicks",
        lambda _base: ION_TRAP,
    ),
    "nv-centre": NodeKind(
        "memory of 10 spins in diamond, one of which emits: single clicks", lambda _base: NV_CENTRE
    ),
    "atomic-ensemble": NodeKind(
        "memory of 62 modes of a crystal that is read out soon: single clicks",
        lambda _base: ATOMIC_ENSEMBLE,
    ),
    "station": NodeKind(
        "detectors behind a beam splitter: of a switch it heralds pairs of memories that emit",
        lambda _base: STATION,
    ),
}
NODE_KINDS = Registry("qmn.devices", lambda each: isinstance(each, NodeKind), OWN)


def switch_parts(device: Device) -> dict[str, Any]:
    """Return the parts of a quantum switch of such hardware, as keywords of OpticalSwitch.

    There are two memories, for the links to either side, each with half of the qubits that emit.
    """
    parts = {"analyser": device.analyser, "detectors": device.detectors, "gates": device.gates}
    if HERALD not in device.features:
        return {"analysers": 1, **parts}
    memory = replace(device.memory, capacity=max(1, device.memory.capacity // 2))
    return {"analysers": 1, **parts, "memories": 2, "memory": memory, "emitter": device.emitter}


def node_device(kind: str, base: Device, where: str = "node") -> Device:
    """Return the device of a host of a kind; raise BadParameter with the kinds there are."""
    check_choice(where, kind, NODE_KINDS, BadParameter)
    return NODE_KINDS[kind].of(base)
