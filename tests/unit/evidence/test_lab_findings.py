"""Findings of labs, of runs whose counts are those of closed forms: what each finds is these."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from math import exp
from pathlib import Path
from typing import Any, cast, get_type_hints

import numpy as np
import pytest
from recorded_run import asked, received

from evidence.curves import theory
from evidence.labs import catalogue
from evidence.labs.lab import Finding, Run
from qmn.results.run_result import RunResult
from wire.results.figures import Figures, KeyFigures, PairFigures, SealFigures
from wire.results.run_result import RESULT, NetqasmJob, ServiceJob
from wire.typed_json import is_needed

NOTHING: Mapping[Any, object] = {int: 0, float: 0.0, bool: False, str: ""}
ASKED: Mapping[str, dict[str, Any]] = {"netqasm": {"application": "teleported"}}
MANY = 1_000_000
ROUNDED = 3e-6  # of as many


def run_of(folder: Path, service: str, job: ServiceJob | NetqasmJob, **known: Any) -> Run:
    """Return a run that has written such a result into a folder of its own."""
    folder.mkdir()
    facts = RunResult(
        service=service,
        hosts=["alice", "bob"],
        topology="sdc",
        mode="native",
        controller="ryu",
        seed=1,
        parameters=asked(service, ASKED.get(service, {"receiver": "bob"})),
        backend="chp",
        time_scale=1.0,
        job=job,
        **known,
    )
    facts.write(folder)
    return Run(folder, json.loads((folder / RESULT).read_text()))


def figures(kind: type[Figures], **known: Any) -> Any:
    """Return figures, of which those that are not given say nothing."""
    hints = get_type_hints(kind)
    names = [each.name for each in fields(cast("Any", kind)) if is_needed(each)]
    return kind(**{name: NOTHING.get(hints[name]) for name in names} | known)


def found(lab: str, runs: Mapping[str, Run]) -> Sequence[Finding]:
    return catalogue.lab(lab).findings(runs)


def own(lab: str) -> dict[str, Any]:
    """Return what the module of a lab has."""
    names: dict[str, Any] = catalogue.lab(lab).findings.__globals__
    return names


def named(findings: Sequence[Finding], what: str) -> Finding:
    (finding,) = [each for each in findings if each.what == what]
    return finding


def test_a_seal_loses_half_of_what_is_intercepted_in_visibility(tmp_path: Path) -> None:
    """One of four intercepted pairs differs; so the visibility is 1 - 2 f/4."""
    tapped = {"whole": 0.0, "a-quarter": 0.25, "half": 0.5, "seven-tenths": 0.7}
    errors = {name: fraction / 4 for name, fraction in tapped.items()} | {"nobody": 0.0}
    runs = {}
    for name, rate in {**errors, "intruder": 0.25}.items():
        asking = figures(SealFigures, compared=MANY, error_rate=rate, alarm=name == "intruder")
        runs[name] = run_of(tmp_path / name, "seal", ServiceJob(asking=asking))
    *seen, alarms, silence = found("seal", runs)
    for finding, fraction in zip(seen, tapped.values(), strict=True):
        assert finding.at == fraction
        assert finding.ours.value == pytest.approx(1 - fraction / 2, abs=ROUNDED)
    assert alarms.agrees(0)
    assert silence.agrees(0)


def test_bits_a_pair_are_those_of_werner_pairs(tmp_path: Path) -> None:
    """Each of three errors comes with (1 - F)/3, whatever symbol was sent."""
    runs = {}
    for name, fidelity in own("sdc-fibre")["FIDELITIES"].items():
        wrong = round(MANY * (1 - fidelity) / 3)
        confusion = np.full((4, 4), wrong) + np.eye(4, dtype=int) * (MANY - 4 * wrong)
        job = ServiceJob(asked=received(confusion.tolist()))
        runs[name] = run_of(tmp_path / name, "sdc", job, delivered=True)
    *capacities, image = found("sdc-fibre", runs)
    for finding in capacities:
        assert finding.at is not None
        noise = theory.of_fidelity(finding.at)
        assert finding.ours.value == pytest.approx(theory.capacity(noise), abs=1e-4)
    assert image.agrees(0)


def test_pairs_after_a_cut_are_judged_by_how_many_are_like_phi(tmp_path: Path) -> None:
    """(2F + 1)/3 of the outcomes are, and 2 (1 - F)/3 of them wrong; light is 10.9 times less."""
    runs = {}
    counts = {
        when: {
            "came": round(MANY / times),
            "emitted": MANY,
            "sampled": MANY,
            "like_phi": round(MANY * (2 * fidelity + 1) / 3),
        }
        for when, fidelity, times in (("before", 0.978, 2), ("after", 0.947, 2 * 10.9))
    }
    runs["cut"] = Run(tmp_path, {"found": {**counts, "outage_s": 3.0}})
    wide = figures(SealFigures, compared=MANY, error_rate=2 * (1 - 0.76) / 3)
    runs["wide"] = run_of(tmp_path / "wide", "seal", ServiceJob(asking=wide))
    findings = found("recovery", runs)
    for what, value in (
        ("light, times less", 10.9),
        ("F after, less F before", -0.031),
        ("F before", 0.978),
        ("F after", 0.947),
        ("F, all channels", 0.76),
        ("s dark", 3.0),
    ):
        assert named(findings, what).ours.value == pytest.approx(value, rel=2e-5, abs=ROUNDED)


def split(right: int, wrong: int, count: int) -> list[list[int]]:
    """Return count outcomes of alice and bob: `right` as often, the rest `wrong`; of two bits."""
    values = [right] * (count - wrong) + [right ^ 1] * wrong
    return [[value >> 1 for value in values], [value & 1 for value in values]]


@pytest.mark.parametrize("wrong", [0, 9, 30])
def test_a_teleported_gate_is_judged_by_its_stabilisers(tmp_path: Path, wrong: int) -> None:
    """Of stabilisers (2F + 1)/3 have equal outcomes if the process has F; a CZ has (4F + 1)/5."""
    count, runs = 90, {}
    for name in own("ion-traps")["FIDELITIES"]:
        blocks = [split(state, wrong // 2, count) for state in range(4)]
        blocks += [split(0, wrong, count)] * 3
        round_of = {role: [block[i] for block in blocks] for i, role in enumerate(("alice", "bob"))}
        job = NetqasmJob(roles={"alice": "alice", "bob": "bob"}, outputs=cast("Any", [round_of]))
        runs[name] = run_of(tmp_path / name, "netqasm", job)
    process = (3 * (count - wrong) / count - 1) / 2
    for finding in found("ion-traps", runs):
        right = {"cz": (4 * process + 1) / 5, "grover": 1 - wrong // 2 / count}[finding.chart]
        assert finding.ours.value == pytest.approx(right)


@pytest.mark.parametrize("kind", ["copper", "controller", "switch"])
def test_halves_of_a_block_wait_for_each_other_at_both_hosts(kind: str) -> None:
    """The mean of q^k for k below N is (1 - q^N) / (N (1 - q)), with q = exp(-2 / (rate T2))."""
    lab, photons, delay_s = own("ip-latency"), 40_000, 1e-6
    rate_hz, t2_s = 4e9, 20e-6
    fixed_s = lab["DELAYS"][kind] * delay_s + lab["FLIGHTS"][kind] * 1.0 / 2.04e8
    fixed_s += lab["BLOCKS"][kind] * photons / rate_hz
    q = exp(-2 / (rate_hz * t2_s))
    coherent = exp(-fixed_s / t2_s) * (1 - q**photons) / (photons * (1 - q))
    assert exp(-lab["waits"](kind, delay_s, photons)) == pytest.approx(coherent, rel=1e-6)


def test_the_decoy_lab_counts_what_the_papers_error_correction_would_leave(tmp_path: Path) -> None:
    """A session that leaks more has as many fewer bits: what the paper would leave is the same."""
    lab, runs = own("decoy"), {}
    for place, km in enumerate(lab["SIFTED"]):
        gain, qber, sifted = lab["gain"](km), lab["qber"](km), 10**7
        pulses = round(2 * sifted / gain)
        spent = 1.16 * sifted * theory.entropy((qber, 1 - qber))
        leaked = round(sifted * (0.1 + place / 100))
        asking = figures(
            KeyFigures,
            photons=pulses,
            raw_bits=2 * sifted,
            sifted_bits=sifted + 10**6,
            disclosed_bits=10**6,
            qber=qber,
            key_bits=round(lab["secret"](km) * pulses + spent) - leaked,
            leaked_bits=leaked,
        )
        runs[f"{km}-km"] = run_of(tmp_path / str(km), "bb84", ServiceJob(asking=asking))
    for finding in found("decoy", runs):
        assert finding.published is not None
        value = finding.published.value
        assert finding.ours.value == pytest.approx(value, rel=1e-4, abs=1e-7), finding.what


def test_key_rates_of_links_are_clicks_times_their_processing(tmp_path: Path) -> None:
    """Of 1e9 pulses/s .88 * .37 of the clicks are key bits."""
    lab, runs = own("link-budgets"), {}
    for name, link in lab["LINKS"].items():
        clicks = round(link["key_hz"] / (0.88 * 0.37))
        asking = figures(KeyFigures, photons=10**9, raw_bits=clicks)
        runs[name] = run_of(tmp_path / name, "bb84", ServiceJob(asking=asking))
    for finding in found("link-budgets", runs):
        assert finding.published is not None
        assert finding.ours.value == pytest.approx(finding.published.value, abs=0.5)


def test_readings_of_an_estimate_are_corrected_for_once_at_either_end(tmp_path: Path) -> None:
    """Two readings keep (2r - 1)^2 of each correlation; 4F - 1 is three of these."""
    lab, runs = own("cross-check"), {}
    for figure in lab["FIGURES"]["figures"]:
        kept = (2 * figure["readout"] - 1) ** 2
        f = (1 + (4 * figure["purified"] - 1) * kept) / 4
        asking = figures(
            PairFigures,
            fidelity=f,
            fidelity_low=f - 0.01,
            fidelity_high=f + 0.01,
            compared=MANY,
            survived=round(MANY * figure["success"]),
        )
        runs[figure["name"]] = run_of(
            tmp_path / figure["name"], "distribute", ServiceJob(asking=asking)
        )
    for finding in found("cross-check", runs):
        assert finding.published is not None
        assert finding.ours.value == pytest.approx(finding.published.value, abs=1e-6)
