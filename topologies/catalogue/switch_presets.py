"""Named sets of optics of quantum switches, each with its source.

qmn run sdc --switch preset=mems
qmn run sdc --switch q1.preset=piezo --switch q1.insertion_loss_db=0.8
self.addSwitch("q1", cls=OpticalSwitch, preset="lithium-niobate")
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wire.parameters.checks import check_choice
from wire.parameters.physics import BadParameter
from wire.parameters.switch import OPTICS, QuantumSwitch


@dataclass(frozen=True)
class SwitchPreset:
    """Differences from an ideal switch, and the source of their numbers."""

    source: str
    optics: Mapping[str, float]


SWITCH_PRESETS = {
    "ideal": SwitchPreset("nothing is lost or strays, and 100 ns to switch", {}),
    "mems": SwitchPreset(
        "mirrors, 136 x 136: milliseconds to switch, under 2 dB (Mission Apollo, arXiv:2208.10041, "
        "as we remember its figures); 10 ms, and crosstalk as in catalogues, are our choice",
        {"insertion_loss_db": 2.0, "switching_time_s": 0.01, "crosstalk_db": 50.0},
    ),
    "piezo": SwitchPreset(
        "collimators that piezo actuators steer: under 1 dB (Light Reading, Polatis Reveals Switch "
        "Secrets, 28 September 2001); 25 ms and 50 dB as we remember the maker's catalogue",
        {"insertion_loss_db": 1.0, "switching_time_s": 0.025, "crosstalk_db": 50.0},
    ),
    "wavelength-selective": SwitchPreset(
        "liquid crystal on silicon (review: Photonics 4, 22, 2017): 5 to 8 dB (Opelink, Optical "
        "Switch Specifications Guide, 2026); 0.1 s and 30 dB are our estimates",
        {"insertion_loss_db": 6.5, "switching_time_s": 0.1, "crosstalk_db": 30.0},
    ),
    # Entangled states pass with 4 % decoherence at most, switched a million times a second.
    "lithium-niobate": SwitchPreset(
        "the prototype of the Universal Quantum Switch (arXiv:2604.21902, 2026): at most 4 % "
        "decoherence, entangled states switched at 1 MHz; loss and crosstalk are our estimates",
        {
            "insertion_loss_db": 3.0,
            "switching_time_s": 1e-6,
            "crosstalk_db": 20.0,
            "depolarizing": 0.04,
        },
    ),
    # A process fidelity of F is depolarising with p = 4 (1 - F) / 3.
    "electro-optic": SwitchPreset(
        "a router of electro-optic crystals: 0.057 dB, 22 dB, process fidelity over 99 % "
        "(arXiv:2502.12554, 2025), rise time 2.9 ns (arXiv:2401.06369)",
        {
            "insertion_loss_db": 0.057,
            "switching_time_s": 2.9e-9,
            "crosstalk_db": 22.0,
            "depolarizing": 4 * 0.01 / 3,
        },
    ),
    # A contrast of 120:1 is 20.8 dB; the state's fidelity fell by less than .002.
    "all-optical": SwitchPreset(
        "a loop of fibre that pump pulses switch: 1.5 dB, contrast 120:1, window 200 ps, no "
        "measurable degradation of entanglement (arXiv:1106.5738)",
        {"insertion_loss_db": 1.5, "switching_time_s": 200e-12, "crosstalk_db": 20.8},
    ),
}


def optics_of(name: str, options: Mapping[str, Any]) -> QuantumSwitch:
    """Return the optics of a switch: what is given, else what its preset says.

    Raise BadParameter if a value is out of range.
    """
    preset = options.get("preset") or "ideal"
    check_choice(f"{name}: preset", preset, SWITCH_PRESETS, BadParameter)
    settings = {each: options[each] for each in OPTICS & options.keys()}
    paths = list(settings.pop("paths", ()))
    switch = QuantumSwitch(name, **{**SWITCH_PRESETS[preset].optics, **settings}, paths=paths)
    switch.check()
    return switch
