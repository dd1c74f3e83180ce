"""Physical effects over the real components, one by one, each beside its closed form.

Those of services and nodes of their own are with these. Bounds are five standard errors.
"""

from math import erf, exp, factorial, sqrt
from pathlib import Path
from re import search

import pytest
from test_run_heralded import STATION, emitters
from test_run_nodes import log_of, polarised, require_estimate, result_of, run
from test_run_qkd import run_qkd

BITS = 20_000
POISSON = sum(
    exp(-0.1) * 0.1**pairs / factorial(pairs) * (1 - 2.0 ** (1 - pairs)) / 2
    for pairs in range(2, 20)
)  # both see light of several pairs: where these do not agree, either tells a coin


def devices(**report: object) -> list[str]:
    """Return the options of devices; two underscores are for a dot."""
    pairs = [f"{name.replace('__', '.')}={value}" for name, value in report.items()]
    return [word for pair in pairs for word in ("--device", pair)]


def fiber(**figure: float) -> list[str]:
    """Return the options of the fibre to bob, of 30 km."""
    words = [f"q1-bob.{name}={value}" for name, value in {"length_km": 30, **figure}.items()]
    return [word for each in words for word in ("--fiber", each)]


def counted(name: str, log: list[str]) -> int:
    """Return the sum of a number over lines of the event log."""
    return sum(int(found[1]) for line in log if (found := search(rf"\b{name}=(\d+)", line)))


SCRAMBLED = ["--length-km", "1", "--fiber", "polarization_drift_rad_per_sqrt_km=4.5"]
SCRAMBLED += ["--fiber", "polarization_drift_time_s=1e-9"]
TIME_BINS = devices(alice__source__encoding="time-bin", bob__detectors__encoding="time-bin")
EFFECTS: dict[str, tuple[list[str], float]] = {
    # Each photon meets turns of its own; rms angles are .1 and .12 rad at the root of 30 km.
    "polarisation drift": (
        fiber(polarization_drift_rad_per_sqrt_km=0.1, polarization_drift_time_s=1e-8),
        (1 - exp(-0.3 / 3)) / 2,
    ),
    "phase drift, which Z does not see": (
        [*fiber(phase_drift_rad_per_sqrt_km=0.12, phase_drift_time_s=1e-8), *TIME_BINS],
        (1 - exp(-0.432 / 2)) / 4,
    ),
    "polarisation drift of time bins, which Z does not see": (  # at a relay, with (1 - V) / 2 in X
        [
            *("--protocol", "mdi"),
            *fiber(polarization_drift_rad_per_sqrt_km=0.1, polarization_drift_time_s=1e-8),
            *devices(alice__source__encoding="time-bin", bob__source__encoding="time-bin"),
            *devices(charlie__detectors__encoding="time-bin"),
        ],
        (1 - exp(-0.3 / 3)) / 2 / 4,
    ),
    "loss by polarisation": (  # about any axis: of 3 dB, amplitudes are 1 and 10^(-3 / 20)
        fiber(pdl_db=3, polarization_drift_time_s=1e-8),
        (1 - 10**-0.15) ** 2 / (3 * (1 + 10**-0.3)),
    ),
    "bursts": (  # a quarter of the time, and shorter than from photon to photon
        fiber(burst_depolarizing=0.4, burst_start_hz=1e9, burst_end_hz=3e9),
        0.4 / 2 / 4,
    ),
    "a Pauli channel": (fiber(pauli_x=0.01, pauli_y=0.02, pauli_z=0.04), (0.03 + 0.06) / 2),
    "states that are prepared wrongly": (devices(alice__source__preparation_error=0.04), 0.04),
    "bits that are reported wrongly": (devices(bob__detectors__readout_error=0.03), 0.03),
    "further pairs of a pulse": (
        [
            *("--protocol", "bbm92"),
            *devices(charlie__source__statistics="poisson", charlie__source__mean_pairs=0.1),
        ],
        POISSON / -(exp(-0.1) - 1),
    ),
}


@pytest.mark.nightly
@pytest.mark.parametrize("effect", EFFECTS)
def test_keys_have_the_errors_of_each_effect(tmp_path: Path, effect: str) -> None:
    words, qber = EFFECTS[effect]
    given = [*words, "--count", str(BITS), "--test-fraction", "0.5", "--bound", "asymptotic"]
    done, result = run_qkd(tmp_path, *given)
    assert done.returncode == 0, done.stdout + done.stderr
    report = result["job"]["asking"]
    assert report["disclosed_bits"] > BITS / 3
    assert abs(report["qber"] - qber) < 5 * sqrt(qber * (1 - qber) / report["disclosed_bits"])


@pytest.mark.nightly
def test_light_is_counted_in_the_gate_that_it_comes_in(tmp_path: Path) -> None:
    """Jitter of 300 and 400 ps is one of 500, and the gate ends as far from its middle."""
    jitter = devices(alice__source__jitter_ps=300, bob__detectors__jitter_ps=400)
    done, result = run_qkd(tmp_path, *jitter, "--count", str(BITS), "--bound", "asymptotic")
    assert done.returncode == 0, done.stdout + done.stderr
    report, seen = result["job"]["asking"], erf(500 / 500 / sqrt(2))
    error = sqrt(seen * (1 - seen) / report["photons"])
    assert abs(report["raw_bits"] / report["photons"] - seen) < 5 * error
    assert report["qber"] == 0


@pytest.mark.nightly
def test_the_h_of_a_bell_measurement_by_gates_errs_behind_the_cx(tmp_path: Path) -> None:
    """Half of p1 = .2 takes Phi+ for Phi-: F = .90, where noise before the CX gave .8526."""
    words = ["swap", "--topology", "chain,1", "--count", "400", "--sample", "0.8"]
    for part in ("analysers=1", "memories=2", "analyser.kind=gates"):
        words += ["--switch", part]
    words += ["--switch", "gates.one_qubit_depolarizing=0.2"]
    require_estimate(result_of(tmp_path, *words)["job"]["asking"], polarised(0.9), 0.0)


@pytest.mark.nightly
def test_photons_whose_ways_differ_by_less_than_a_nanosecond_interfere_less(
    tmp_path: Path,
) -> None:
    """Alice's 5.2 cm are passed twice, in .51 ns: P = [1 - exp(-(s tau)^2)] / 2."""
    words = ["sdc", "--fiber", "alice-q1.length_km=5.2e-5", "--seed", "8401"]
    words += devices(bob__analyser__bandwidth_rad_per_s=3e9, bob__analyser__delay_line_km=0)
    assert run(tmp_path, *words).returncode == 1  # no frame comes through
    measured = [line for line in log_of(tmp_path) if " bell-measure " in line]
    wrong, pairs = (counted(name, measured) for name in ("distinguishable", "photons"))
    expected = (1 - exp(-((3e9 * 2 * 5.2e-2 / 2.04e8) ** 2))) / 2
    assert pairs > 1000
    assert abs(wrong / pairs - expected) < 5 * sqrt(expected * (1 - expected) / pairs)


@pytest.mark.nightly
def test_pairs_in_time_bins_swap_by_the_overlap_of_their_polarisations(tmp_path: Path) -> None:
    """Scrambled for each photon again, it is 1/2 on average: F = (1 + V) / 2."""
    words = ["swap", "--topology", "chain,1", "--count", "400", "--sample", "0.8", *SCRAMBLED]
    for part in ("analysers=1", "memories=2", "detectors.encoding=time-bin"):
        words += ["--switch", part]
    for part in ("source", "detectors"):
        words += ["--device", f"*.{part}.encoding=time-bin"]
    require_estimate(result_of(tmp_path, *words)["job"]["asking"], polarised(0.75), 0.0)


@pytest.mark.nightly
def test_unlike_detectors_do_not_tell_what_linear_optics_cannot(tmp_path: Path) -> None:
    """Phi reaches either detector of the phase, of which one sees 1 - m: I is seen with 1 - m/2."""
    mismatch = 0.6
    words = ["sdc", "--message", "photons " * 60, "--seed", "1"]
    words += devices(bob__analyser__kind="linear")
    words += devices(bob__detectors__efficiency_mismatch=mismatch)
    run(tmp_path, *words)  # whether frames come through or not
    log = log_of(tmp_path)
    sent = counted("I", [line for line in log if " alice " in line and " apply " in line])
    seen = counted(r"Phi\+", [line for line in log if " bell-measure " in line])
    expected = 1 - mismatch / 2
    assert sent > 400
    assert abs(seen / sent - expected) < 5 * sqrt(expected * (1 - expected) / sent)


@pytest.mark.nightly
@pytest.mark.parametrize("scrambled", [False, True])
def test_single_clicks_herald_pairs_as_good_as_qubits_are_dark(
    tmp_path: Path, scrambled: bool
) -> None:
    """Of 2 a (1 - a) e + a^2 (2 e - e^2) heralds the first are pairs: F = 1 - a for small e.

    Fibres that scramble polarisation keep 2/3 of their coherence: the mean of its amplitude.
    """
    bright, efficiency = 0.1, 0.05
    words = ["distribute", *STATION, *emitters("alice", "bob")]
    for host in ("alice", "bob"):
        reports = {"scheme": "single-click", "bright_state": bright, "efficiency": efficiency}
        reports["fidelity"] = 1
        words += devices(**{f"{host}__emitter__{name}": value for name, value in reports.items()})
    words += ["--loss-db-per-km", "0"]
    words += ["--switch", "insertion_loss_db=0", "--count", "400", "--sample", "0.5"]
    words += SCRAMBLED if scrambled else ["--length-km", "1"]
    asking = result_of(tmp_path, *words)["job"]["asking"]
    fidelity = (1 - bright) / (1 - bright * efficiency / 2) * (5 / 6 if scrambled else 1)
    require_estimate(asking, polarised(fidelity), 0.0)


@pytest.mark.nightly
def test_a_request_for_12_pairs_makes_those_and_a_sample(tmp_path: Path) -> None:
    """A memory takes 32: 20 of them are sampled, and for 10 more 1.05 x 10 + 1 are made, 11.5."""
    words = ["distribute", "--node", "ion-trap", "--count", "12"]
    words += ["--length-km", "0.01", "--loss-db-per-km", "0"]
    asking = result_of(tmp_path, *words)["job"]["asking"]
    assert (asking["pairs"], asking["emitted"], asking["sampled"]) == (12, 44, 30)


@pytest.mark.nightly
def test_what_pairs_are_when_they_are_handed_over_is_told(tmp_path: Path) -> None:
    """Of coherence c = 2 F - 1 at their sample exp(-2 t / T2) is left at both ends."""
    t2_s = 0.5
    words = ["distribute", "--count", "2000", "--sample", "0.5", "--time", "paced=5"]
    words += devices(alice__memory__t2_s=t2_s, bob__memory__t2_s=t2_s)
    asking = result_of(tmp_path, *words)["job"]["asking"]
    coherence = (2 * asking["fidelity"] - 1) * exp(-2 * asking["fidelity_age_s"] / t2_s)
    assert asking["fidelity_age_s"] > 0
    assert abs(asking["fidelity_expected"] - (1 + coherence) / 2) < 1e-6
