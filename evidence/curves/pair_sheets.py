"""Curves of pairs: superdense coding, loss, teleportation, swapping, the CHSH test."""

from evidence.curves import theory
from evidence.curves.figure import Mark
from evidence.curves.sheet import Curve, Sheet

CODES = ("none", "repetition", "hamming", "golay")
EXPERIMENT = Mark(
    theory.EXPERIMENT_P,
    *theory.EXPERIMENT_BITS,
    "experiment, arXiv:1609.00713\n(at the p of this capacity)",
)
DEPOLARIZING = "depolarising probability p of the fibre"

PAIR_SHEETS = (
    Sheet(
        "superdense",
        "sdc",
        {"depolarizing": "0:0.2:11", "pairs": 500_000},
        [
            Curve(
                "bit-error",
                "Superdense coding: bit error p/2",
                "depolarizing",
                DEPOLARIZING,
                "bit_error",
            ),
            Curve(
                "dibit-error",
                "Superdense coding: dibit error 3p/4",
                "depolarizing",
                DEPOLARIZING,
                "dibit_error",
            ),
            Curve(
                "capacity",
                "Superdense coding: capacity 2 - H(1-3p/4, p/4, p/4, p/4)",
                "depolarizing",
                DEPOLARIZING,
                "capacity",
                marks=[EXPERIMENT],
            ),
        ],
    ),
    Sheet(
        "codes",
        "sdc",
        {
            "depolarizing": [0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2],
            "fec": list(CODES),
            "interleave": ["off", "on"],
            "pairs": 2_000_000,
        },
        [
            Curve(
                "codes",
                "Bit error after decoding",
                "depolarizing",
                DEPOLARIZING,
                "residual_error",
                by=["fec", "interleave"],
            )
        ],
    ),
    Sheet(
        "loss",
        "sdc",
        {"length_km": "0:50:11", "loss_db_per_km": [0.2, 0.35, 3.0], "pairs": 200_000},
        [
            Curve(
                "loss",
                "Light that comes through a fibre: 10^(-loss/10 dB)",
                "length_km",
                "length of the fibre (km)",
                "arrived",
                by=["loss_db_per_km"],
                logarithmic=True,
            )
        ],
    ),
    Sheet(
        "classical-light",
        "classical-light",
        {
            "length_km": [1, 5, 10, 20, 30, 40, 60],
            "classical_way": ["along", "against"],
            "pairs": 1_000_000,
        },
        [
            Curve(
                "classical-light",
                "1 mW of classical light beside the photons: errors by what it scatters",
                "length_km",
                "length of the fibre (km)",
                "qber",
                by=["classical_way"],
                logarithmic=True,
            )
        ],
    ),
    Sheet(
        "teleportation",
        "teleport",
        {"fidelity": "0.25:1:11", "pairs": 500_000},
        [
            Curve(
                "teleportation",
                "Teleportation by Werner pairs: (2F + 1)/3",
                "fidelity",
                "fidelity F of the pairs",
                "teleported",
            )
        ],
    ),
    Sheet(
        "swapping",
        "swap",
        {
            "first_fidelity": "0.25:1:11",
            "second_fidelity": [0.7, 0.9, 1.0],
            "pairs": 500_000,
        },
        [
            Curve(
                "swapping",
                "Swapping of Werner pairs: F1 F2 + (1 - F1)(1 - F2)/3",
                "first_fidelity",
                "fidelity F1 of the first pair",
                "swapped",
                by=["second_fidelity"],
            )
        ],
    ),
    Sheet(
        "chsh",
        "chsh",
        {"fidelity": "0.25:1:11", "pairs": 400_000},
        [
            Curve(
                "chsh",
                "CHSH test: S = 2 sqrt 2 (4F - 1)/3",
                "fidelity",
                "fidelity F of the pairs",
                "chsh",
                levels=[(2.0, "local realism: at most 2")],
            )
        ],
    ),
    Sheet(
        "spied-pairs",
        "spied-pairs",
        {"fraction": "0:1:6", "fidelity": [0.9, 1.0], "pairs": 200_000},
        [
            Curve(
                f"spied-pairs-{measure}",
                f"E91, of which eve measures and resends a fraction f: {text}",
                "fraction",
                "fraction f",
                measure,
                by=["fidelity"],
                levels=levels,
            )
            for measure, text, levels in (
                ("chsh", "S (1 - f/2)", [(2.0, "no key: at most 2")]),
                ("qber", "error rate", [(0.11, "no key")]),
            )
        ],
    ),
    Sheet(
        "pairs-made",
        "pairs-made",
        {"wanted": [3, 12, 50, 200], "loss_db": [0.0, 3.0, 6.0]},
        [
            Curve(
                "pairs-made",
                "Pairs made for each that is wanted: a sample of 30, or a tenth, and losses",
                "wanted",
                "pairs wanted",
                "made",
                by=["loss_db"],
            )
        ],
    ),
)
