"""Curves of links: polarisation, timing, heralding, repeaters."""

from evidence.curves.sheet import Curve, Sheet

LINK_SHEETS = (
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
)
