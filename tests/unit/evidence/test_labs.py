"""Labs: which there are, their pages, their runs, and when one fails."""

import csv
import json
import math
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from rich.console import Console

from evidence.curves.estimates import NOTHING, Estimate
from evidence.curves.figure import residuals
from evidence.kinds.published import LabOptions, lab_done
from evidence.labs import catalogue, outcome
from evidence.labs.drawing import draw_charts, picture
from evidence.labs.lab import Chart, Finding, Lab, Published, Run, exactly, in_range, paired
from evidence.labs.networks import command_for
from qmn.__main__ import described
from qmn.jobs.counted_service import checked
from qmn.needs import Needs, needs_of
from qmn.options import BadInput
from qmn.verbs.run import service_request
from topologies.networks.network import Signals

NAMES = catalogue.names()
HEADS = ["What the paper did", "Parameters", "What is reproduced", "What is not"]


def page(name: str) -> str:
    return (catalogue.LABS / name / "README.md").read_text()


def lab_of(*findings: Finding, tolerance: float = 5) -> Lab:
    """Return a lab that needs no network."""
    return Lab("a title", "a paper", {}, lambda _runs: findings, tolerance=tolerance)


def status_of(lab: Lab, out: Path) -> bool:
    options, console = LabOptions(out=out), Console(quiet=True)
    with Signals() as signals:
        return lab_done("trial", lab, None, options, signals, console, (print, print))


def test_the_list_names_every_folder_with_its_title(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["lab", "published"]
    arguments = described(words).parse_args(words)
    assert arguments.call(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    folders = {path.name for path in catalogue.LABS.iterdir() if path.is_dir()}
    assert {line.split()[0] for line in lines} == folders == set(NAMES)
    for line in lines:
        assert line.endswith(catalogue.lab(line.split()[0]).title)


@pytest.mark.parametrize("name", NAMES)
def test_a_page_shows_every_figure_of_its_lab(name: str) -> None:
    for chart in catalogue.lab(name).charts:
        assert f"]({chart.name}.png)" in page(name), f"{chart.name}: setup/lab-pictures makes it"


def test_an_unknown_lab_is_refused_with_the_nearest() -> None:
    with pytest.raises(BadInput, match="there is no lab sdc-fiber: did you mean sdc-fibre"):
        catalogue.lab("sdc-fiber")
    with pytest.raises(BadInput, match="choose one of city-fibre, coexistence, cross-check"):
        catalogue.lab("nothing")


def test_a_lab_is_also_found_by_its_path(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"no lab my-lab: .*my-lab/my_lab.py is to say LAB"):
        catalogue.lab(f"{tmp_path}/my-lab")
    (tmp_path / "my-lab").mkdir()
    text = "from evidence.labs.lab import Lab\nLAB = Lab('mine', 'p', {}, lambda runs: [])\n"
    (tmp_path / "my-lab" / "my_lab.py").write_text(text)
    assert catalogue.lab(f"{tmp_path}/my-lab").title == "mine"


@pytest.mark.parametrize("name", NAMES)
def test_a_lab_has_a_hundred_lines_of_code_at_most(name: str) -> None:
    files = (catalogue.LABS / name).glob("*.py")
    lines = [line for file in files for line in file.read_text().splitlines()]
    assert sum(1 for line in lines if line.strip()) <= 100


@pytest.mark.parametrize("name", NAMES)
def test_a_page_names_paper_and_parameters_and_what_is_not_reproduced(name: str) -> None:
    text = page(name)
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == HEADS
    sections = dict(zip(HEADS, re.split(r"^## .*$", text, flags=re.MULTILINE)[1:], strict=True))
    source = re.search(r"arXiv:\d{4}\.\d{4,5}|doi \S+", catalogue.lab(name).paper)
    assert source is not None
    assert source[0] in sections["What the paper did"]
    rows = re.findall(r"^\| .* \| .* \| .* \|$", sections["Parameters"], re.MULTILINE)
    assert rows[0] == "| parameter | value | where from |"
    assert len(rows) >= 4
    assert "this model under these parameters" in " ".join(sections["What is reproduced"].split())
    assert "experiment" not in sections["What is reproduced"]
    assert len(sections["What is not"].split()) >= 10
    assert f"qmn lab published {name}\n" in text


@pytest.mark.parametrize("name", NAMES)
def test_every_run_of_a_lab_is_a_command(name: str, tmp_path: Path) -> None:
    lab = catalogue.lab(name)
    assert lab.runs
    for text in lab.runs.values():
        words = command_for(text, 1, tmp_path)
        arguments = described(words).parse_args(words)
        assert needs_of(arguments) is Needs.NETWORK
        if text.startswith("script "):  # which says no more than these to the script
            assert arguments.file.is_file()
            assert arguments.words == ["--seed", "1", "--runs", str(tmp_path)]
        else:
            assert (arguments.seed, arguments.runs) == (1, tmp_path)
        if getattr(arguments, "service", "") == words[1]:  # else a job of another kind
            checked(service_request(arguments))
        assert "--seed" not in shlex.split(text)


def test_a_difference_is_in_standard_errors_of_all_three_kinds() -> None:
    published = Published(1.0, 0.3, "table")
    assert Finding("", "x", Estimate(2.3, 0.4), published).difference == pytest.approx(2.6)
    with_inputs = Finding("", "x", Estimate(2.3, 0.0), published, inputs=0.4)
    assert with_inputs.difference == pytest.approx(2.6)
    assert with_inputs.agrees(2.7)
    assert not with_inputs.agrees(2.5)
    assert Finding("", "x", Estimate(2.3, 0.4)).difference is None


@pytest.mark.parametrize(
    ("value", "difference"), [(2.36, 0), (2.5, 0), (2.74, 0), (2.84, 2), (2.26, -2)]
)
def test_a_number_in_a_published_range_does_not_differ(value: float, difference: float) -> None:
    finding = in_range("S", Estimate(value, 0.05), 2.36, 2.74, "abstract")
    assert finding.difference == pytest.approx(difference)
    assert finding.published is not None
    assert outcome.stated(finding.published) == "2.36 to 2.74"


def test_a_count_is_the_same_or_differs() -> None:
    assert exactly("x", 4, 4, "table").agrees(0)
    assert exactly("x", 3, 4, "table").difference == -math.inf
    assert not exactly("x", 3, 4, "table").agrees(1e9)


def test_errors_of_what_both_measured_of_the_same_draws_are_of_the_differences() -> None:
    """Differences 0.5, 1, 1.5: their mean is 1, with an error of 0.5 / sqrt(3)."""
    finding = paired("x", [11.5, 22.0, 33.5], [11.0, 21.0, 32.0], "their program")
    assert finding.difference == pytest.approx(1 / (0.5 / math.sqrt(3)))
    assert paired("x", [1.0, 2.0], [1.0, 2.0], "their program").difference == 0.0


def test_what_was_not_measured_does_not_agree() -> None:
    assert not Finding("", "x", NOTHING, Published(1.0, 0.1, "table")).agrees(5)


@pytest.mark.parametrize(("tolerance", "good"), [(3.0, True), (2.5, False)])
def test_a_lab_fails_beyond_its_tolerance(tmp_path: Path, tolerance: float, good: bool) -> None:
    finding = Finding("", "x", Estimate(2.3, 0.4), Published(1.0, 0.3, "table"))
    assert status_of(lab_of(finding, tolerance=tolerance), tmp_path) is good
    (folder,) = tmp_path.iterdir()
    facts = json.loads((folder / "lab.json").read_text())
    assert (facts["agrees"], facts["tolerance"]) == (good, tolerance)
    assert facts["findings"][0]["difference"] == pytest.approx(2.6)
    with (folder / "findings.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["ours"], row["published"], row["agrees"]) == ("2.3", "1.0", str(good))


def test_one_finding_too_far_is_enough(tmp_path: Path) -> None:
    assert not status_of(lab_of(exactly("x", 1, 1, ""), exactly("y", 1, 2, "")), tmp_path)
    (folder,) = tmp_path.iterdir()
    facts = json.loads((folder / "lab.json").read_text())
    assert [each["agrees"] for each in facts["findings"]] == [True, False]


def test_a_star_stands_for_what_is_published_and_a_closed_form_is_the_line(tmp_path: Path) -> None:
    chart = Chart("line", "title", "x", "y", lambda x: 2 * x)
    star = Finding("line", "a", Estimate(2.5, 0.5), Published(2.2, 0.1, "table"), 1.0, 0.2)
    form = Finding("line", "b", Estimate(4.0, 0.5), Published(4.0, 0.0, "equation"), 2.0)
    other = Finding("another", "c", Estimate(1.0, 0.5), at=1.0)
    made = picture(chart, [star, form])
    assert [(mark.x, mark.y, mark.error, mark.x_error) for mark in made.marks] == [
        (1.0, 2.2, 0.1, 0.2)
    ]
    assert residuals(made) == {0: [(1.0, 1.0), (2.0, 0.0)]}
    wide = Finding("line", "d", Estimate(1.0, 0.5), Published(2.5, 0.0, "abstract", 1.5), 3.0)
    assert [(mark.y, mark.error) for mark in picture(chart, [wide]).marks] == [(2.5, 1.5)]
    (file,) = draw_charts([chart], [star, form, other], tmp_path)
    assert file.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.6577, 0.006, "1.6577 ± 0.0060"),
        (2.42866, 0.0873, "2.429 ± 0.087"),
        (4.0, 0.0, "4"),
        (math.nan, math.nan, "nan"),
        (0.003918, 8.6e-5, "0.003918 ± 0.000086"),
    ],
)
def test_a_number_has_two_digits_of_its_error(value: float, error: float, text: str) -> None:
    assert outcome.number(value, error) == text


def test_a_run_tells_when_events_were_in_time_of_the_network(tmp_path: Path) -> None:
    day = "2026-11-22T18:37:1"
    lines = [f"{day}4.302784646Z bob attempt port=bob-q0 block 1/1"]
    lines += [f"{day}4.802784646Z alice attempt port=alice-q0 block 1/0"]
    lines += [f"{day}9.302784646Z q1-analyser1 herald Psi+=529 Psi-=522 of 8215 attempts"]
    (tmp_path / "quantum.log").write_text("\n".join(lines) + "\n")
    run = Run(tmp_path, {})
    assert run.times_s("attempt") == [0.0, 0.5]
    assert run.times_s("herald") == [5.0]
    assert run.times_s("measure") == []


@pytest.mark.parametrize("km", [1, 10, 25])
def test_sequences_links_take_the_rounds_that_their_page_says(km: int) -> None:
    """Six flights of light or word a round, the second if one has clicked; both succeed once."""
    content = json.loads((catalogue.LABS / "link-times" / "sequence_links.json").read_text())
    pairs, attempts, took_s = content["links"][str(km)]
    light = 0.6 * 0.9 * 10 ** (-0.2 * km / 10)
    assert (content["emitted"], content["detected"], content["db_per_km"]) == (0.6, 0.9, 0.2)
    assert abs(pairs - attempts * light**2 / 2) < 5 * math.sqrt(pairs)
    one, both = light / 2, light * (1 - light) / 2 + light**2 / 8
    seconds = 6 * (1 + one + both) * km * 1e3 / 2.04e8
    assert took_s / attempts == pytest.approx(seconds, rel=5 * 0.5 / math.sqrt(attempts))


@pytest.mark.parametrize("km", [1, 10, 25])
def test_quisps_links_take_a_round_trip_and_ten_spacings_of_photons(km: int) -> None:
    """The station orders the next photon for so much later than its word can be there."""
    content = json.loads((catalogue.LABS / "link-times" / "quisp_links.json").read_text())
    pairs, attempts, took_s = content["links"][str(km)]
    light = 0.6 * 0.9 * 10 ** (-0.2 * km / 10)
    assert (content["emitted"], content["detected"], content["db_per_km"]) == (0.6, 0.9, 0.2)
    assert abs(pairs - attempts * light**2 / 2) < 5 * math.sqrt(pairs)
    assert took_s == pytest.approx(attempts * (2 * km * 1e3 / 2.04e8 + 10 * 1e-6), rel=1e-6)
    assert content["late_s"] == pytest.approx(10 * 1e-6)


def test_quisp_purifies_and_swaps_as_others_say() -> None:
    """Its purification is SeQUeNCe's; its swap is that of Pauli errors.

    Of correlations, each swap keeps those of both pairs, a gate without noise, and the readings
    that tell the correction: of X one, of Z the other, of Y both.
    """
    theirs, quisp = (
        json.loads((catalogue.LABS / lab / "figures.json").read_text())["figures"]
        for lab in ("cross-check", "quisp")
    )
    exact = {figure["name"]: figure for figure in theirs}
    for figure in quisp:
        if "swapped" in figure:
            pair = (4 * figure["fidelity"] - 1) / 3
            read = 2 * figure["readout"] - 1
            reports = {"swapped": 1 / 4 + pair**2 * figure["gate"] * read * (2 + read) / 4}
        else:
            reports = {key: exact[figure["name"]][key] for key in ("purified", "success")}
        for key, value in reports.items():
            mean, error = figure[key]
            assert 0 < error < 0.02
            assert abs(mean - value) < 5 * error, (figure["name"], key)
    assert len(quisp) == len(exact) + 5


def test_mqns_swaps_and_purifies_waiting_pairs_as_closed_forms_say() -> None:
    """Werner parameters multiply and fall by exp(-t / T); BBPSSW by Bennett et al., PRL 76, 722."""
    page = tomllib.loads((catalogue.LABS / "multiverse" / "figures.toml").read_text())
    for figure in page["figures"]:
        links = {"swapped": 2, "swapped-twice": 3, "purified": 1, "swapped-purified": 2}
        parameter = ((4 * figure["source"] - 1) / 3) ** links[figure["job"]]
        kept = math.exp(-figure.get("waits", 0.0))
        before = (1 + 3 * parameter * kept) / 4
        if not figure["job"].endswith("purified"):
            assert figure["fidelity"] == pytest.approx(before, abs=1e-6)
            continue
        wrong = (1 - before) / 3
        success = before**2 + 2 * before * wrong + 5 * wrong**2
        purified = (before**2 + wrong**2) / success
        assert figure["fidelity"] == pytest.approx((1 + (4 * purified - 1) * kept) / 4, abs=1e-6)
        if "survived" in figure:
            error = math.sqrt(success * (1 - success) / figure["rounds"])
            assert abs(figure["survived"] / figure["rounds"] - success) < 5 * error
