"""Curves of devices: interference, detectors, gates, memories, sources of light."""

from evidence.curves.sheet import Curve, Sheet

DEVICE_SHEETS = (
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
        "purification",
        "purification",
        {
            "fidelity": "0.6:1:9",
            "two_qubit_depolarizing": [0.0, 0.04],
            "readout_error": [0.0, 0.02],
            "pairs": 200_000,
        },
        [
            Curve(
                f"purification-{measure}",
                f"A round of BBPSSW by gates and readings that err: {text}",
                "fidelity",
                "fidelity F of the pairs",
                measure,
                by=["two_qubit_depolarizing", "readout_error"],
            )
            for measure, text in (("fidelity", "fidelity"), ("success", "pairs kept"))
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
        "unstored",
        "memory",
        {
            "rate_hz": "100:1e6:9:log",
            "t2_s": [0.01, 0.1, 1.0],
            "stored": [0],
            "pairs": 100_000,
        },
        [
            Curve(
                "memory-unstored",
                "1,000 pairs that nobody stores wait for the last: X and X, T2",
                "rate_hz",
                "pairs a second",
                "xx",
                by=["t2_s"],
            )
        ],
    ),
    Sheet(
        "handed-over",
        "handed-over",
        {"waited_s": "0:0.1:6", "fidelity": [0.8, 0.95], "pairs": 300_000},
        [
            Curve(
                f"handed-over-{measure}",
                f"Pairs that wait after their sample (T1 = .2 s, T2 = .1 s): {text}",
                "waited_s",
                "wait between sample and delivery (s)",
                measure,
                by=["fidelity"],
            )
            for measure, text in (
                ("expected", "what it lets expect"),
                ("delivered", "what they are"),
            )
        ],
    ),
    Sheet(
        "memory-heralds",
        "memory-heralds",
        {
            "loss_db": "0:20:6",
            "herald_efficiency": [0.8],
            "false_herald": [0.0, 0.001, 0.01],
            "pairs": 300_000,
        },
        [
            Curve(
                f"memory-heralds-{measure}",
                f"A memory that tells of .8 of the photons that come: {text}",
                "loss_db",
                "loss (dB)",
                measure,
                by=["false_herald"],
            )
            for measure, text in (
                ("heralded", "heralds"),
                ("there", "heralds of photons that are there"),
            )
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
        "dark-counts",
        "multi-pair",
        {
            "dark_count": "1e-4:0.1:7:log",
            "statistics": "single",
            "loss_db": [0.0, 10.0, 20.0],
            "pairs": 1_000_000,
        },
        [
            Curve(
                "dark-counts",
                "Error rate by dark counts, of single pairs: 1/2 where they are all that is seen",
                "dark_count",
                "dark counts of a detector in a gate",
                "qber",
                by=["loss_db"],
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
)
