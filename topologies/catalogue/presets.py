"""Named sets of parameters for all fibres and all hosts' devices of a network, with their source.

qmn run sdc --preset fiber-2017 --frame-bytes 8
sudo PYTHONPATH=. mn --custom topologies/sdc.py --topo sdc,preset=metro
"""

from dataclasses import dataclass, field
from typing import Any

from wire.parameters.checks import check_choice
from wire.parameters.physics import BadParameter, Detectors, Device, PairSource

# Superconducting nanowires: 92 % efficient, under 130 dark counts a second, over 150 million
# counts a second, jitter 14.8 ps full width at half maximum (arXiv:1611.02726).
NANOWIRES = Detectors(
    efficiency=0.92, dark_count_hz=130.0, gate_s=1e-9, dead_time_s=6.7e-9, jitter_ps=6.3
)


@dataclass(frozen=True)
class Preset:
    """Differences from the ideal, and the source of their numbers."""

    source: str
    fiber: dict[str, Any] = field(
        default_factory=dict
    )  # wire.parameters.fiber.FiberOptics, of every fibre
    device: Device = field(default_factory=Device)  # of every host


PRESETS = {
    "ideal": Preset("nothing is lost and nothing goes wrong"),
    # 1.665 bits a pair are the capacity 2 - H(1 - 3p/4, p/4, p/4, p/4) for p = .0598, that is of
    # Werner pairs with F = 1 - 3p/4, whatever the part of the set-up that spoils them.
    "fiber-2017": Preset(
        "Williams, Sadlier, Humble, Physical Review Letters 118, 050501 (arXiv:1609.00713): "
        "1.665 +- 0.018 bits a pair by a complete Bell measurement",
        device=Device(source=PairSource(fidelity=1 - 0.75 * 0.0598)),
    ),
    # Entangled pairs over a city's fibres with the polarisation held: fidelities from 85 % (82 km)
    # to 99 % (10 m). The residual drift of polarisation is our estimate.
    "metro": Preset(
        "fibre: catalogues of ITU-T G.652.D, connectors .25 dB each; pairs with stabilised "
        "polarisation: arXiv:2504.08927; detectors: arXiv:1611.02726",
        fiber={
            "kind": "smf",
            "length_km": 5.0,
            "connectors_db": 0.5,
            "polarization_drift_rad_per_sqrt_km": 0.05,
            "temperature_walk_k_per_sqrt_s": 0.001,
        },
        device=Device(
            source=PairSource(fidelity=0.95),
            detectors=NANOWIRES,
        ),
    ),
    "lab": Preset(
        "fibre: PANDA (wire/parameters/fiber.py), connectors .25 dB each; pairs over 10 m: "
        "arXiv:2504.08927; detectors: arXiv:1611.02726",
        fiber={"kind": "pm", "length_km": 0.01, "connectors_db": 0.5},
        device=Device(source=PairSource(fidelity=0.99), detectors=NANOWIRES),
    ),
}


def preset(name: str) -> Preset:
    """Return the preset of this name; raise BadParameter with those there are."""
    check_choice("preset", name, PRESETS, BadParameter)
    return PRESETS[name]
