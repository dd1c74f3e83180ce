"""Curves of GHZ and graph states, of sensing, and of keys."""

from collections.abc import Sequence

from evidence.curves import relay_theory, relayed_keys
from evidence.curves.figure import Limit, Mark
from evidence.curves.sensing import limits
from evidence.curves.sheet import Curve, Sheet

SENSORS, SENSED = (2, 3, 4, 5, 6), 200  # hosts, probes at each


def sensing_limits() -> list[Limit]:
    """Return Heisenberg's limit and the standard quantum limit of sensing."""
    names = "Heisenberg's limit 1/(N sqrt M)", "standard quantum limit 1/sqrt(N M)"
    lines = zip(*(limits(hosts, SENSED) for hosts in SENSORS), strict=True)
    return [
        Limit(name, list(zip(SENSORS, line, strict=True)))
        for name, line in zip(names, lines, strict=True)
    ]


def endless_decoys(lengths_km: Sequence[float]) -> list[Mark]:
    """Return the keys of Lo, Curty and Qi's closed form, where photon numbers are known."""
    mean = relayed_keys.SIGNAL
    like = relayed_keys.DARK_COUNT, relayed_keys.ERROR, relayed_keys.CORRECTION
    keys = [
        relay_theory.endless_key(mean, relayed_keys.arrives(length_km), *like)
        for length_km in lengths_km
    ]
    labels = ["endless decoys, Phys. Rev. Lett. 108, 130503", *[""] * (len(keys) - 1)]
    places = zip(lengths_km, keys, labels, strict=True)
    return [Mark(length_km, each, 0.0, label) for length_km, each, label in places]


KEY_SHEETS = (
    Sheet(
        "ghz",
        "ghz",
        {"depolarizing": "0:0.2:6", "hosts": [3, 4, 6], "pairs": 60_000},
        [
            Curve(
                "ghz",
                "GHZ states by fusing pairs: ((1 - p/2)^n + (1 - p)^n)/2 of n links",
                "depolarizing",
                "depolarising p of each link",
                "fidelity",
                by=["hosts"],
                levels=[(0.5, "no witness of entanglement among all")],
            )
        ],
    ),
    Sheet(
        "graph",
        "graph",
        {"depolarizing": "0:0.2:6", "graph": ["line", "ring", "star", "complete"], "pairs": 60_000},
        [
            Curve(
                "graph",
                "Graph states of four hosts by fusing pairs: mean of all stabilisers",
                "depolarizing",
                "depolarising p of each link",
                "fidelity",
                by=["graph"],
                levels=[(0.5, "no witness of entanglement among all")],
            )
        ],
    ),
    Sheet(
        "conference",
        "conference",
        {"depolarizing": "0:0.12:7", "hosts": [3, 4, 6], "pairs": 200_000},
        [
            Curve(
                "conference",
                "Conference keys of n links: 1 - 2 h(Q), Q = (1 - (1 - p)^n)/2",
                "depolarizing",
                "depolarising p of each link",
                "key",
                by=["hosts"],
            )
        ],
    ),
    Sheet(
        "conference-distance",
        "conference-distance",
        {"length_km": "0:40:5", "hosts": [3, 4, 5], "pairs": 400_000},
        [
            Curve(
                f"conference-distance-{measure}",
                f"Conference keys over distance: {text}",
                "length_km",
                "length of each fibre (km)",
                measure,
                by=["hosts"],
                logarithmic=measure != "qber_z",
            )
            for measure, text in (
                ("gain", "states that all hosts see"),
                ("qber_z", "bits of the worst host that differ"),
                ("key", "key of endless sessions"),
            )
        ],
    ),
    *(
        Sheet(
            f"sensing-{axis}",
            "sensing",
            {"hosts": list(SENSORS), "states": SENSED, "estimates": 250, **axes},
            [
                Curve(
                    f"sensing-{axis}",
                    f"Sensing, M = {SENSED}: {text}",
                    "hosts",
                    "hosts N",
                    "mean_error",
                    by=list(axes),
                    limits=sensing_limits(),
                )
            ],
        )
        for axis, text, axes in (
            (
                "loss",
                "lossy detectors",
                {"probes": ["ghz", "separate"], "efficiency": [0.9, 1.0]},
            ),
            ("noise", "noisy links", {"depolarizing": [0.0, 0.05, 0.2]}),
        )
    ),
    Sheet(
        "pair-keys",
        "pair-keys",
        {"length_km": "0:60:4", "protocol": ["bbm92", "e91"], "pairs": 8_000_000},
        [
            Curve(
                f"pair-keys-{measure}",
                f"Keys by entangled pairs, source in the middle: {text}",
                "length_km",
                "length of both fibres (km)",
                measure,
                by=["protocol"],
                logarithmic=measure != "qber",
            )
            for measure, text in (
                ("gain", "pairs seen at both ends"),
                ("qber", "error rate"),
                ("key", "key of long blocks"),
            )
        ],
    ),
    Sheet(
        "spdc-keys",
        "pair-keys",
        {
            "length_km": "0:60:4",
            "statistics": ["poisson", "thermal"],
            "mean_pairs": 0.05,
            "pairs": 16_000_000,
        },
        [
            Curve(
                f"spdc-keys-{measure}",
                f"BBM92 by down-conversion, .05 pairs a pulse, source in the middle: {text}",
                "length_km",
                "length of both fibres (km)",
                measure,
                by=["statistics"],
                logarithmic=measure != "qber",
            )
            for measure, text in (
                ("qber", "error rate by several pairs"),
                ("key", "key of long blocks"),
            )
        ],
    ),
    Sheet(
        "mdi",
        "mdi",
        {"length_km": "0:80:5", "pairs": 6_000_000},
        [
            Curve(
                f"mdi-{measure}",
                f"MDI-QKD by lasers with two decoys, relay in the middle: {text}",
                "length_km",
                "length of both fibres (km)",
                measure,
                marks=endless_decoys((0.0, 20.0, 40.0, 60.0, 80.0, 100.0))
                if measure == "key"
                else (),
                logarithmic=measure in ("gain", "key"),
            )
            for measure, text in (
                ("gain", "signals announced, in Z"),
                ("qber", "errors of signals in Z"),
                ("qber_x", "errors of signals in X"),
                ("key", "key of long blocks"),
            )
        ],
    ),
    Sheet(
        "mdi-spdc",
        "mdi-pairs",
        {"length_km": "0:60:4", "heralding_efficiency": [0.0, 0.7], "pairs": 4_000_000},
        [
            Curve(
                f"mdi-spdc-{measure}",
                f"MDI-QKD by down-conversion, .2 pairs a pulse, relay in the middle: {text}",
                "length_km",
                "length of both fibres (km)",
                measure,
                by=["heralding_efficiency"],
                logarithmic=measure in ("gain", "key"),
            )
            for measure, text in (
                ("gain", "pulses announced, in Z"),
                ("qber", "errors in Z"),
                ("qber_x", "errors in X"),
                ("key", "key of long blocks, photons being counted"),
            )
        ],
    ),
    Sheet(
        "detector-mismatch",
        "light-sources",
        {"efficiency_mismatch": "0:1:6", "pairs": 1_000_000},
        [
            Curve(
                "detector-mismatch",
                "Detectors of unlike efficiency: (1 - m)/(2 - m) ones",
                "efficiency_mismatch",
                "mismatch m of the efficiencies",
                "ones",
            )
        ],
    ),
    Sheet(
        "decoy-states",
        "decoy-states",
        {"length_km": "0:40:5", "mean_photons": [0.3, 0.5], "pairs": 8_000_000},
        [
            Curve(
                f"decoy-states-{measure}",
                f"BB84 with decoy states (arXiv:1311.7129): {text}",
                "length_km",
                "length of the fibre (km)",
                measure,
                by=["mean_photons"],
                logarithmic=measure != "qber",
            )
            for measure, text in (
                ("key", "key of endless blocks"),
                ("gain", "signal pulses seen"),
                ("qber", "errors of the signal"),
            )
        ],
    ),
    Sheet(
        "photon-splitting",
        "photon-splitting",
        {"loss_db": "0:12:5", "mean_photons": [0.2, 0.5], "eve": ["off", "on"], "pairs": 400_000},
        [
            Curve(
                f"photon-splitting-{measure}",
                f"Photon-number splitting, no decoys: {text}",
                "loss_db",
                "loss that alice and bob expect (dB)",
                measure,
                by=["eve", "mean_photons"],
            )
            for measure, text in (
                ("gain", "as many pulses are seen"),
                ("known", "what eve knows"),
                ("key", "the key (GLLP)"),
            )
        ],
    ),
    Sheet(
        "photon-splitting-decoys",
        "photon-splitting",
        {"loss_db": "0:12:5", "eve": ["off", "on"], "decoys": ["on"], "pairs": 2_000_000},
        [
            Curve(
                f"photon-splitting-decoys-{measure}",
                f"Photon-number splitting and decoy states: {text}",
                "loss_db",
                "loss that alice and bob expect (dB)",
                measure,
                by=["eve"],
            )
            for measure, text in (
                ("weak", "weak pulses that are seen"),
                ("key", "key of endless blocks"),
            )
        ],
    ),
)
