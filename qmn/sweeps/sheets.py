"""The curves that `make curves` draws: each a grid, and the figures made of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from qmn.sweeps import relay_theory, relayed_keys, theory
from qmn.sweeps.catalogue import EXPERIMENTS
from qmn.sweeps.figure import Limit, Mark, Picture
from qmn.sweeps.grid import Grid, Row, build
from qmn.sweeps.links import routes
from qmn.sweeps.pictures import series
from qmn.sweeps.seal import error, question
from qmn.sweeps.sensing import limits
from qmn.sweeps.wald import wald_pairs_to_alarm
from qmn.traffic.erlang import reduced_load

SENSORS, SENSED = (2, 3, 4, 5, 6), 200  # hosts, probes at each
CODES = ("none", "repetition", "hamming", "golay")
EXPERIMENT = Mark(
    theory.EXPERIMENT_P,
    *theory.EXPERIMENT_BITS,
    "experiment, arXiv:1609.00713\n(at the p of this capacity)",
)


def wald_marks(fractions: Sequence[float]) -> list[Mark]:
    """Return Wald's expected sample numbers of a tamper seal at these fractions."""
    complete = EXPERIMENTS["seal"].complete
    points = [complete({"tapped": fraction}) for fraction in fractions]
    pairs = [wald_pairs_to_alarm(question(values), error(values)) for values in points]
    labels = ["Wald's approximations (1945)", *[""] * (len(points) - 1)]  # one in the legend
    places = zip(fractions, pairs, labels, strict=True)
    return [Mark(fraction, each, 0.0, label) for fraction, each, label in places]


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


def reduced_load_marks(loads: Sequence[float], links: int) -> list[Mark]:
    """Return the reduced-load approximation of sessions over a chain of links at these loads."""
    complete = EXPERIMENTS["links"].complete
    points = [complete({"load": load, "links": links}) for load in loads]
    shares = [reduced_load(*routes(values))[0] for values in points]
    labels = [f"reduced load, {links} links", *[""] * (len(loads) - 1)]  # one in the legend
    return [Mark(*each[:2], 0.0, each[2]) for each in zip(loads, shares, labels, strict=True)]


@dataclass(frozen=True)
class Curve:
    """One figure: a measure over one axis, with a series for each value of the others."""

    file: str
    title: str
    x: str
    x_label: str
    measure: str
    by: Sequence[str] = ()
    marks: Sequence[Mark] = field(default=())
    levels: Sequence[tuple[float, str]] = field(default=())
    logarithmic: bool = False
    limits: Sequence[Limit] = field(default=())


@dataclass(frozen=True)
class Sheet:
    """A grid and its curves."""

    name: str
    experiment: str
    axes: dict[str, object]
    curves: Sequence[Curve]

    @property
    def grid(self) -> Grid:
        """Return the grid."""
        return build(EXPERIMENTS[self.experiment], self.axes)

    def unmeasured(self, rows: Sequence[Row]) -> list[str]:
        """Name every point of a curve at which nothing could be measured."""
        experiment = EXPERIMENTS[self.experiment]
        return [
            f"{experiment.place(values)}: no {curve.measure} was measured"
            for curve in self.curves
            for values, outcome in rows
            if math.isnan(outcome[curve.measure].value)
        ]

    def picture(self, curve: Curve, rows: Sequence[Row]) -> Picture:
        """Return a curve of the sheet with these points."""
        experiment = EXPERIMENTS[self.experiment]
        measure = experiment.measure(curve.measure)
        if curve.logarithmic:
            measure = replace(measure, logarithmic=True)
        return Picture(
            curve.title,
            experiment.parameter(curve.x),
            curve.x_label,
            measure,
            series(rows, [experiment.parameter(name) for name in curve.by], curve.measure),
            curve.marks,
            curve.levels,
            curve.limits,
        )


TAPPED = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0)
LOADS = (0.5, 1.0, 2.0, 4.0, 6.0, 8.0)  # erlang
DEPOLARIZING = "depolarising probability p of the fibre"
SHEETS = (
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
        "interference",
        "hom",
        {"delay_ps": "-3:3:13", "visibility": [0.7, 0.9, 1.0], "pairs": 400_000},
        [
            Curve(
                "hong-ou-mandel",
                "Hong-Ou-Mandel dip, bandwidth 1e12 rad/s",
                "delay_ps",
                "delay tau between the photons (ps)",
                "coincidences",
                by=["visibility"],
            )
        ],
    ),
    Sheet(
        "interference-dispersion",
        "hom",
        {
            "delay_ps": "-60:60:13",
            "bandwidth_rad_per_s": [0.0],
            "bandwidth_nm": [0.1, 0.3],
            "dispersion_ps_per_nm": [0.0, 170.0],
            "pairs": 400_000,
        },
        [
            Curve(
                "hong-ou-mandel-dispersion",
                "Hong-Ou-Mandel dip behind 10 km of standard fibre in one arm",
                "delay_ps",
                "delay tau between the photons (ps)",
                "coincidences",
                by=["bandwidth_nm", "dispersion_ps_per_nm"],
            )
        ],
    ),
    Sheet(
        "dead-time",
        "dead-time",
        {"dead_time_s": "0:2e-7:9", "efficiency": [0.1, 0.3, 0.9], "pairs": 400_000},
        [
            Curve(
                "dead-time",
                "Dead time of a detector, 100 million pulses/s",
                "dead_time_s",
                "dead time",
                "clicks",
                by=["efficiency"],
            )
        ],
    ),
    Sheet(
        "gated-bell",
        "gated-bell",
        {
            "one_qubit_depolarizing": "0:0.4:9",
            "two_qubit_depolarizing": [0.0, 0.1],
            "pairs": 400_000,
        },
        [
            Curve(
                f"gated-bell-{state}",
                f"Bell measurement by gates: {text}",
                "one_qubit_depolarizing",
                "depolarising probability p1 of the H",
                measure,
                by=["two_qubit_depolarizing"],
            )
            for state, text, measure in (
                ("phase", "wrong phase (1 - p2) p1/2 + p2/4", "phi_minus"),
                ("parity", "wrong parity p2/4", "psi_plus"),
            )
        ],
    ),
    Sheet(
        "memory",
        "memory",
        {"rate_hz": "100:1e6:9:log", "t2_s": [0.01, 0.1, 1.0], "t1_s": [1.0], "pairs": 100_000},
        [
            Curve(
                f"memory-{measure}",
                f"1,000 pairs wait in memories for the last: {text}",
                "rate_hz",
                "pairs a second",
                measure,
                by=["t2_s"],
            )
            for measure, text in (("xx", "X and X, T2"), ("zz", "Z and Z, T1 = 1 s"))
        ],
    ),
    Sheet(
        "fresh-outcomes",
        "fresh-outcomes",
        {"uses": [2, 3, 10, 30], "pairs": 200_000},
        [
            Curve(
                "fresh-outcomes",
                "Blocks of the same name: outcomes that are equal, 1/2",
                "uses",
                "blocks of this name",
                "equal",
            )
        ],
    ),
    Sheet(
        "multi-pair",
        "multi-pair",
        {
            "mean_pairs": [0.05, 0.1, 0.2, 0.5, 1.0],
            "statistics": ["poisson", "thermal"],
            "loss_db": [0.0, 10.0],
            "pairs": 1_000_000,
        },
        [
            Curve(
                "multi-pair",
                "Error rate by several pairs in a pulse",
                "mean_pairs",
                "mean number of pairs in a pulse",
                "qber",
                by=["statistics", "loss_db"],
            )
        ],
    ),
    Sheet(
        "weak-pulses",
        "weak-pulses",
        {"loss_db": "0:20:6", "mean_photons": [0.01, 0.1, 0.5], "pairs": 1_000_000},
        [
            Curve(
                f"weak-pulses-{measure}",
                f"BB84 with a weak laser: {text}",
                "loss_db",
                "loss (dB)",
                measure,
                by=["mean_photons"],
            )
            for measure, text in (
                ("gain", "pulses seen, 1 - exp(-mu t)"),
                ("key", "key without decoys (GLLP)"),
            )
        ],
    ),
    Sheet(
        "light-sources",
        "light-sources",
        {
            "length_km": "0:60:4",
            "source": [
                "single",
                "single-g2-0.02",
                "laser-0.1",
                "laser-0.01",
                "heralded",
            ],
            "pairs": 1_000_000,
        },
        [
            Curve(
                f"light-sources-{measure}",
                f"BB84 by sources of light: {text}",
                "length_km",
                "length of the fibre (km)",
                measure,
                by=["source"],
                logarithmic=measure != "qber",
            )
            for measure, text in (
                ("gain", "pulses seen"),
                ("qber", "error rate"),
                ("key", "key of long blocks (GLLP)"),
            )
        ],
    ),
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
                ("gain", "signals told of, in Z"),
                ("qber", "errors of signals in Z"),
                ("qber_x", "errors of signals in X"),
                ("key", "key of long blocks"),
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
    Sheet(
        "polarization",
        "polarization",
        {
            "length_km": [0.1, 1.0, 2.0, 5.0, 10.0],
            "polarization_drift_rad_per_sqrt_km": [0.05, 0.3, 1.0],
            "pairs": 60_000,
        },
        [
            Curve(
                f"polarization-{basis}",
                f"Polarisation behind a fibre, error in {basis.upper()}",
                "length_km",
                "length of the fibre (km)",
                basis,
                by=["polarization_drift_rad_per_sqrt_km"],
            )
            for basis in ("z", "x")
        ],
    ),
    Sheet(
        "polarization-modes",
        "polarization-modes",
        {
            "length_km": [1.0, 10.0, 100.0, 1000.0],
            "pdl_db": [0.0, 3.0],
            "pmd_ps_per_sqrt_km": [0.1],
            "bandwidth_nm": [0.0, 0.3, 1.0],
            "pairs": 200_000,
        },
        [
            Curve(
                "polarization-modes",
                "Polarisation-dependent loss, mode dispersion 0.1 ps/sqrt(km)",
                "length_km",
                "length of the fibre (km)",
                "error",
                by=["bandwidth_nm", "pdl_db"],
            )
        ],
    ),
    Sheet(
        "timing",
        "timing",
        {
            "length_km": "0:50:6",
            "bandwidth_nm": [0.0, 0.1, 1.0],
            "jitter_ps": [0.0, 300.0],
            "pairs": 50_000,
        },
        [
            Curve(
                "timing",
                "Photons in gates of 1 ns behind standard fibre (17 ps/(nm km))",
                "length_km",
                "length of the fibre (km)",
                "counted",
                by=["bandwidth_nm", "jitter_ps"],
            )
        ],
    ),
    Sheet(
        "delay-line",
        "delay-line",
        {
            "difference_km": "0:50:6",
            "delay_line_db_per_km": [0.0, 0.2],
            "pairs": 100_000,
        },
        [
            Curve(
                "delay-line",
                "Bell measurement of halves whose ways differ",
                "difference_km",
                "difference of the ways (km)",
                "coincidences",
                by=["delay_line_db_per_km"],
            )
        ],
    ),
    Sheet(
        "heralding",
        "heralding",
        {"arm_km": "5:50:10", "scheme": ["two-click", "single-click"], "pairs": 60_000},
        [
            Curve(
                "heralded-rate",
                "Pairs heralded by a station in the middle",
                "arm_km",
                "way to the station (km)",
                "rate",
                by=["scheme"],
                logarithmic=True,
            ),
            Curve(
                "heralded-fidelity",
                "Pairs heralded by a station in the middle (V = .9, alpha = .1)",
                "arm_km",
                "way to the station (km)",
                "fidelity",
                by=["scheme"],
            ),
        ],
    ),
    Sheet(
        "gated-swap",
        "gated-swap",
        {
            "readout_error": "0:0.2:6",
            "two_qubit_s": [0.0, 0.01, 0.05],
            "two_qubit_depolarizing": 0.05,
        },
        [
            Curve(
                "gated-swap",
                "A repeater that takes its time (T2 = .1 s at the ends, gate noise .05)",
                "readout_error",
                "error of each reading",
                "fidelity",
                by=["two_qubit_s"],
            )
        ],
    ),
    Sheet(
        "nested",
        "nested",
        {"fidelity": "0.8:1:6", "rounds": [0, 1], "levels": [1, 2]},
        [
            Curve(
                "nested",
                "Links joined two by two, purified before each swap (DEJMPS)",
                "fidelity",
                "fidelity of the links",
                "fidelity",
                by=["levels", "rounds"],
            )
        ],
    ),
    Sheet(
        "cutoff",
        "cutoff",
        {"cutoff_s": [0.0015, 0.0025, 0.0035, 0.0055, 0.0085, 0.0125, 0.0205, 0.0405]},
        [
            Curve(
                f"cutoff-{measure}",
                "Two pairs of a heralded link (p = 1/8, an attempt a ms, T2 = 20 ms)",
                "cutoff_s",
                "cut-off time of the memories",
                measure,
            )
            for measure in ("rate", "fidelity")
        ],
    ),
    Sheet(
        "blocking",
        "light",
        {
            "load": [0.5, 1.0, 2.0, 4.0, 6.0, 8.0],
            "channels": [1, 4],
            "holding": ["exponential", "constant"],
            "sessions": 5_000,
        },
        [
            Curve(
                "erlang-b",
                "Sessions refused on a trunk of fibres: Erlang B",
                "load",
                "arrivals in a mean holding time (erlang)",
                "blocked",
                by=["channels", "holding"],
            )
        ],
    ),
    Sheet(
        "links",
        "links",
        {"load": list(LOADS), "links": [1, 3], "sessions": 10_000},
        [
            Curve(
                "links-through",
                "Sessions refused that pass a chain of links, beside those of each link",
                "load",
                "load of each link, half of it of sessions that pass all (erlang)",
                "through",
                by=["links"],
                marks=reduced_load_marks(LOADS, 3),
            ),
            Curve(
                "links-one",
                "Sessions of the first link refused, beside those that pass the whole chain",
                "load",
                "load of each link, half of it of sessions that pass all (erlang)",
                "one_link",
                by=["links"],
            ),
        ],
    ),
    Sheet(
        "several-fibers",
        "several-fibers",
        {"load": list(LOADS), "channels": [4, 8], "sessions": 10_000},
        [
            Curve(
                f"kaufman-roberts-{measure}",
                f"Sessions of {text} refused on a trunk: Kaufman and Roberts",
                "load",
                "fibres that are asked for in a mean holding time (erlang)",
                measure,
                by=["channels"],
            )
            for measure, text in (("narrow", "one fibre"), ("wide", "two fibres"))
        ],
    ),
    *(
        Sheet(
            f"queueing-{channels}",
            "light",
            {
                "load": [channels * share for share in (0.2, 0.4, 0.6, 0.7, 0.8)],
                "channels": [channels],
                "contention": ["queue"],
                "sessions": 10_000,
            },
            [
                Curve(
                    f"erlang-c-{measure}-{channels}",
                    f"{text} on a trunk of {channels} fibres: Erlang C",
                    "load",
                    "arrivals in a mean holding time (erlang)",
                    measure,
                )
                for measure, text in (("waited", "Sessions that wait"), ("wait", "Mean wait"))
            ],
        )
        for channels in (1, 4)
    ),
    Sheet(
        "schedulers",
        "schedule",
        {
            "rate_per_s": [5.0, 10.0, 20.0, 30.0, 45.0, 60.0],
            "order": ["fcfs", "edf", "slots"],
            "sessions": 2_000,
        },
        [
            Curve(
                f"schedulers-{measure}",
                f"{text} on the map of GARR, signalling included",
                "rate_per_s",
                "requests/s",
                measure,
                by=["order"],
            )
            for measure, text in (
                ("in_time", "Requests that have light in time"),
                ("urgent_in_time", "Urgent requests that have light in time"),
            )
        ],
    ),
    Sheet(
        "seal",
        "seal",
        {"tapped": list(TAPPED)},
        [
            Curve(
                "seal",
                "A tamper seal: pairs compared until the alarm, enumerated",
                "tapped",
                "fraction of the photons that is measured and resent",
                "pairs",
                marks=wald_marks(TAPPED),
            )
        ],
    ),
)
