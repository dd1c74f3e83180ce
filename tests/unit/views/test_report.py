"""The report of a run: one page that needs nothing else."""

import json
import re
import xml.etree.ElementTree as ET
from argparse import Namespace
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

import pytest
from recorded_run import ALICE, BOB, MS, NETWORK, SETUP, capture, record_run, run_of, segment

from applications.conference.service import ConferenceFigures
from applications.graph_states.service import GraphFigures
from applications.sensing.service import SensingFigures
from qmn.results.sentences import of_eve, sentence
from views.report import report_file
from views.report.error_counts import reported
from views.report.figures import _error_rates, _losses, key_distribution_figures
from views.report.first_photons import first_photons
from views.report.light_paths import Hop, LightPath, light_paths
from views.report.page import _fibers
from views.report.report_file import NoReport, made_report, report_of_run
from views.report.run_facts import RunFacts, read_run
from views.verbs import report
from wire.dispatcher_pb2 import BlockId, Event
from wire.metadata.blocks import Block, Emit, Frame, Report
from wire.results.figures import (
    EveFigures,
    KeyFigures,
    KeyProgress,
    LoadFigures,
    StoredKeyFigures,
    TunnelFigures,
)
from wire.results.run_result import ServiceJob

FIGURES = [
    "Bell states sent and received",
    "The network",
    "The handshake, in both layers",
    "Bell pairs a second",
    "Errors over time",
    "Loss of each hop",
    "Set-up of light paths",
]


def made_page(folder: Path) -> str:
    return made_report(folder).read_text()


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the page of a run that went well."""
    return made_page(record_run(tmp_path_factory.mktemp("run")))


def figures(page: str) -> dict[str, str]:
    """Return the text in each figure, by its title."""
    found = re.findall(r"<figure.*?<h2>(.*?)</h2>.*?(<svg.*?</svg>)", page, re.DOTALL)
    spaced = 'xmlns:xlink="http://www.w3.org/1999/xlink"'
    texts = {title: svg.replace("<svg", f"<svg {spaced}", 1) for title, svg in found}
    return {
        title: " ".join(ET.fromstring(text).itertext())  # noqa: S314 (we made it)
        for title, text in texts.items()
    }


def test_the_page_says_how_large_approximations_are(page: str) -> None:
    words = re.sub(r"<[^>]*>", " ", page)
    assert re.search(r"approximated: one thing\s+a probability is wrong by 0.19 at most", words)
    assert re.search(r"approximated: another\s+a probability is wrong by 0.5 at most", words)


def test_every_figure_of_a_run_is_there(page: str) -> None:
    drawn = figures(page)
    assert list(drawn) == FIGURES
    assert "Not drawn" not in page
    words = dict(zip(FIGURES, drawn.values(), strict=True))
    for word in ("alice", "10.0.0.3", "q2", "s1", "5 km, 1 dB", "10 km, 2 dB"):
        assert word in words["The network"]
    for word in ("0.000 ms", "packet-in: set-up held", "barrier", "q1 open 2→3", "100 photons"):
        assert word in words["The handshake, in both layers"]
    for word in ("alice-q0 → bob-q0", "4.5 dB", "q2 1→2: 0.3 dB", "a path may lose 30 dB"):
        assert word in words["Loss of each hop"]
    for word in ("95.2 %", "4.76 %", "10", "00", "11"):  # 20 of 21, and 1 of 21
        assert word in words["Bell states sent and received"]
    assert "p50 3.00 ms" in words["Set-up of light paths"]


def test_the_page_needs_nothing_else_and_runs_nothing(page: str) -> None:
    assert "<script" not in page
    addresses = set(re.findall(r'(?:src|href|url)\s*[=(]\s*"?([^")\s>]+)', page))
    assert all(address.startswith(("#", "data:")) for address in addresses)


def test_no_colour_is_that_of_one_theme_alone(page: str) -> None:
    for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        assert re.findall(r"#[0-9a-fA-F]{6}\b", svg) == []
        assert "var(--ink)" in svg
        texts = re.findall(r"<text [^>]*>", svg)
        assert texts
        assert all("fill: var(--" in text for text in texts)


def test_what_users_wrote_is_no_markup(page: str) -> None:
    assert "none &lt;&amp;&gt;" in page
    assert "<&>" not in page


def test_a_run_says_whether_it_delivered_and_with_which_seed(page: str, tmp_path: Path) -> None:
    assert "delivered exactly" in page
    assert "<td>seed</td><td>1</td>" in page
    assert "<td>fibre: length_km</td><td>5.0</td>" in page
    assert "<td>device: bob</td><td>detectors: efficiency: 0.8</td>" in page
    lost = made_page(record_run(tmp_path, delivered=False))
    assert "NOT DELIVERED" in lost
    assert "delivered exactly" not in lost


@pytest.mark.parametrize(
    ("qber", "error", "verdict"),
    [
        (
            0.269,
            "no key: 566 of 2105 are wrong",
            "No key: an eavesdropper or noise, QBER 26.9 % (21 to 33 %)",
        ),
        (0.01, "no key: 20 blocks without light", "No key: 20 blocks without light"),
        (None, None, "BB84: not done"),
    ],
)
def test_a_run_without_a_key_says_why(qber: float | None, error: str | None, verdict: str) -> None:
    counts = dict.fromkeys(each.name for each in fields(cast("Any", KeyFigures)))
    known = {"qber": qber, "qber_low": 0.2135, "qber_high": 0.3333, "max_qber": 0.1}
    figures_of_keys = KeyFigures(**cast("Any", counts | known))
    result = run_of("bb84", ServiceJob(asking=figures_of_keys), time_scale=1.0)
    result.error = error
    assert sentence(result) == verdict


@pytest.mark.parametrize(
    ("kind", "known", "words"),
    [
        (
            ConferenceFigures,
            {"key_bits": 73_873, "qber_x": 0.02, "qber_z": [0.01, 0.03]},
            "73,873 bits of secret key of 3 hosts, QBER 2.0 % in X, at most 3.0 % in Z",
        ),
        (
            GraphFigures,
            {"states": 1000, "fidelity_at_least": 0.9},
            "1,000 states of 3 hosts, with fidelity at least 0.900",
        ),
        (
            SensingFigures,
            {"sum_rad": 0.3, "sum_error_rad": 0.01},
            "The phases at 3 hosts add up to 0.300 (0.280 to 0.320) rad",
        ),
        (
            LoadFigures,
            {"sessions": 20, "accepted": 8},
            "8 of 20 sessions had light",
        ),
        (
            TunnelFigures,
            {"file_intact": True, "received_bytes": 5000, "keys_used": 11},
            "the file arrived intact, 5,000 bytes under 11 keys",
        ),
        (
            StoredKeyFigures,
            {"keys": 75, "sessions": 3, "sessions_without_key": 1},
            "75 keys of alice and bob in 3 sessions, 1 of them without a key",
        ),
    ],
)
def test_a_run_says_what_its_hosts_share(kind: Any, known: dict[str, Any], words: str) -> None:
    counts = dict.fromkeys((each.name for each in fields(kind)), None)
    shared = {"hosts": 3} if "hosts" in counts else {}
    result = run_of("ghz", ServiceJob(asking=kind(**counts | known | shared)), time_scale=1)
    result.delivered = True
    assert sentence(result) == words


def test_a_key_session_is_drawn_key_by_key() -> None:
    """Of five lines two tell the error rate of a key that is new; the last rate is written."""
    counts = {"photons": 400, "raw_bits": 400, "sifted_bits": 200, "key_bits": 0, "keys": 0}
    rates = [None, [0.03, 0.01, 0.06], [0.03, 0.01, 0.06], [0.25, 0.2, 0.3], None]
    lines = [
        KeyProgress(**cast("Any", counts | {"newest_qber": rate, "elapsed_s": 0.1 * number}))
        for number, rate in enumerate(rates)
    ]
    assert _error_rates(lines) == [(0.1, 0.03, 0.01, 0.06), (0.1 * 3, 0.25, 0.2, 0.3)]
    known = dict.fromkeys((each.name for each in fields(cast("Any", KeyFigures))), None)
    known |= counts | {"qber": 0.14, "qber_low": 0.1, "qber_high": 0.2, "max_qber": 0.1}
    last = KeyFigures(**cast("Any", known | {"elapsed_s": 0.5}))
    result = run_of("bb84", ServiceJob(asking=last), time_scale=1.0)
    run = RunFacts(Path(), result, NETWORK, events=[], setup_ms=[], sender=[*lines, last])
    drawn = figures("".join(key_distribution_figures(run)))
    assert list(drawn) == ["Error rate", "Growth of the key", "From photons to key"]
    assert "25 %" in drawn["Error rate"]
    assert "no key above 10 %" in drawn["Error rate"]
    alone = figures("".join(key_distribution_figures(replace(run, sender=[]))))
    assert list(alone) == ["Error rate", "From photons to key"]
    assert "14 %" in alone["Error rate"]


def test_a_report_says_what_eve_knows() -> None:
    """Eve, who measures and resends, knows half of the bits, and spoils a quarter (BB84)."""
    counts = {"blocks": 1, "lost_blocks": 0, "attack": "resend", "fraction": 0.6}
    eve = EveFigures(**cast("Any", counts | {"photons": 42_064, "measured": 25_197}))
    text = of_eve(run_of("bb84", ServiceJob(eve=eve), time_scale=1.0))
    assert text == (
        "Eve measured 25,197 of 42,064 photons (59.9 %) and sent on the outcomes: she knows 30.0 % "
        "of the sifted bits, and makes 15.0 % of them wrong."
    )
    assert of_eve(run_of("bb84", ServiceJob(), time_scale=1.0)) == ""


def test_first_photons_are_kept_where_bases_agree_and_hostile_names_are_no_markup() -> None:
    """By hand: of six photons three have one basis at both ends, one of them with an error."""
    states = ["|0>", "|1>", "|+>", "|->", "|0>", "|+>"]
    seen = ["Z 0", "X 1", "X 1", "X 1", "Z no click", "<b> 0"]
    events = [
        Event(node="<i>", kind="create", block=BlockId(session=7), first=states),
        Event(node="bob", kind="measure", block=BlockId(session=8), first=seen[::-1]),
        Event(node="bob", kind="measure", block=BlockId(session=7), first=seen),
    ]
    shown = first_photons(events, ("<i>", "bob"))
    kept = re.findall("<td>(.*?)</td>", shown)[-6:]
    assert kept == ["yes", "", "wrong", "yes", "", ""]
    assert "<i>" not in shown
    assert "<b>" not in shown
    rows = unquote(shown.split("data:text/csv,")[1].split('"')[0]).splitlines()
    assert rows[:2] == [
        "photon,<i> sends: basis,<i> sends: bit,bob measures: basis,bob measures: bit,kept",
        "1,Z,0,Z,0,yes",
    ]
    assert first_photons(events[:1], ("<i>", "bob")) == ""


def test_what_was_not_recorded_is_said_and_not_drawn(tmp_path: Path) -> None:
    record_run(tmp_path, captured=False)
    for name in ("quantum.pcapng", "asking.log", "controller.jsonl"):
        (tmp_path / name).unlink()
    result = json.loads((tmp_path / "result.json").read_text())
    (tmp_path / "result.json").write_text(
        json.dumps({**result, "job": {**result["job"], "asked": {}}})
    )
    page = made_page(tmp_path)
    assert list(figures(page)) == ["The network"]
    assert page.count("Not drawn: ") == 6


def test_a_run_without_captures_shows_its_quantum_events(tmp_path: Path) -> None:
    page = made_page(record_run(tmp_path, captured=False))
    assert "Packets were not captured" in page
    drawn = [title.replace("in the quantum layer", "in both layers") for title in figures(page)]
    assert drawn == FIGURES


def test_a_run_that_wrote_no_events_does_not_say_that_nothing_happened(tmp_path: Path) -> None:
    record_run(tmp_path)
    (tmp_path / "quantum.pcapng").unlink()
    result = json.loads((tmp_path / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps({**result, "events": False}))
    page = made_page(tmp_path)
    assert "The handshake, in the classical layer" in figures(page)
    assert page.count("what happened to qubits was not written (--without events)") == 4
    assert "No light path stood" not in page
    assert "no Bell pair was measured" not in page


def test_errors_are_drawn_from_the_reports_of_all_sessions(page: str, tmp_path: Path) -> None:
    record_run(tmp_path)
    assert "in the end: symbol errors 3, lost pairs 40, repeated frames 1" in page
    there, back = (ALICE, BOB), (BOB, ALICE)
    lines = [
        (there, SETUP),
        (there, Emit(1, 1, 103, 50_000_000)),  # of which 100 come to the sender
        (there, Block(1, 1, 100, 0, 0, (Frame(0, 25, 0),))),
        (back, Report(1, 1, 100, lost=5, errors=2, failed=(0,))),
        (back, Report(2, 1, 100, lost=7, errors=4)),
        (back, Report(1, 2, 100, errors=3)),
    ]
    packets, places = [], {there: 0, back: 0}
    for number, (ends, message) in enumerate(lines):
        data = message.encode()
        packets.append((number * MS, segment(ends, places[ends], data)))
        places[ends] += len(data)
    capture(tmp_path / "s1-eth1.pcap", packets)
    counts = reported(tmp_path, NETWORK, "alice")
    assert counts is not None
    assert counts.seconds == [0, 0.003, 0.004, 0.005]
    assert counts.counts == {
        "symbol errors": [0, 2, 6, 7],
        "lost pairs": [0, 8, 15, 15],
        "repeated frames": [0, 1, 1, 1],
    }
    assert "in the end: symbol errors 7, lost pairs 15, repeated frames 1" in made_page(tmp_path)
    assert reported(tmp_path, NETWORK, "bob") is None


def test_the_same_run_gives_the_same_page(tmp_path: Path) -> None:
    record_run(tmp_path)
    assert made_page(tmp_path) == made_page(tmp_path)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NoReport, match="name the folder of a run that has ended"):
        made_report(tmp_path)
    (tmp_path / "result.json").write_text("{}")
    with pytest.raises(NoReport, match="does not say what the network was"):
        made_report(tmp_path)


@pytest.mark.parametrize(
    ("place", "value", "why"),
    [
        ("network fibers 0 length_km", float("nan"), "infinite, or NaN"),
        ("network fibers 0 a node", "nowhere", r"fibres to no node \(nowhere\)"),
        ("network copper 0", ["s1", "s1-eth1", "alice"], "copper without two ends"),
        ("hosts", [], "are not of its network"),
        ("hosts 0", "nobody", "are not of its network"),
        ("job asked confusion 0", [1, 2], "confusion must be a table of counts"),
        ("job asked confusion 0 0", -1, "confusion must be a table of counts"),
        ("network switches 0 paths", [{"in_port": 1}], "has no out_port"),
    ],
)
def test_a_result_that_cannot_be_drawn_is_refused(
    tmp_path: Path, place: str, value: Any, why: str
) -> None:
    """Of another person's run: the types are right, or nearly, and the values are not."""
    file = record_run(tmp_path) / "result.json"
    given = json.loads(file.read_text())
    *way, last = (int(word) if word.isdecimal() else word for word in place.split())
    inner: Any = given
    for word in way:
        inner = inner[word]
    inner[last] = value
    file.write_text(json.dumps(given))
    with pytest.raises(NoReport, match=why):
        made_report(tmp_path)


def test_a_network_that_names_no_switch_of_copper_is_drawn(tmp_path: Path) -> None:
    file = record_run(tmp_path) / "result.json"
    given = json.loads(file.read_text())
    given["network"]["copper_switches"] = []
    file.write_text(json.dumps(given))
    assert "unknown" in figures(made_page(tmp_path))["The handshake, in both layers"]


def test_a_spoiled_capture_is_named_and_ends_no_run(tmp_path: Path) -> None:
    record_run(tmp_path)
    (tmp_path / "quantum.pcapng").write_bytes(b"this is not a capture")
    assert report_of_run(tmp_path).startswith("not made: not a pcapng file")
    assert not (tmp_path / "report.html").exists()


def test_a_long_run_does_not_wait_for_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record_run(tmp_path)
    assert report_of_run(tmp_path) == str(tmp_path / "report.html")
    monkeypatch.setattr(report_file, "AT_MOST_EVENT_BYTES", 100)
    assert report_of_run(tmp_path).endswith(f"`qmn report {tmp_path}` makes it")


def test_the_verb_says_where_the_report_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record_run(tmp_path)
    assert report.call(Namespace(run=tmp_path)) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'report.html'}\n"
    assert report.call(Namespace(run=tmp_path / "none")) == 1
    assert capsys.readouterr().err.startswith("qmn: cannot read ")


def test_lines_that_are_no_json_do_not_matter(tmp_path: Path) -> None:
    record_run(tmp_path)
    with (tmp_path / "asking.log").open("a") as log:
        log.write("a warning\n[1]\n")
    assert len(read_run(tmp_path).sender) == 1


def test_the_page_of_a_large_network_stays_short(tmp_path: Path) -> None:
    """As one of 48 places, which would have forty screens else; fibres are folded always."""
    run = read_run(record_run(tmp_path))
    few = _losses(run, light_paths(run.network, run.events))
    hops = [(Hop("a fibre", loss),) for loss in range(20)]
    paths = [LightPath(f"h{n}-q0", f"h{n}-q1", each) for n, each in enumerate(hops)]
    drawn = _losses(run, paths)
    assert "Every light path that stood" in few
    assert "Of 20 light paths that stood the 12 that lose most" in drawn
    shown = set(map(int, re.findall(r"h(\d+)-q0", drawn)))
    assert shown == set(range(8, 20))
    fibers = [run.network.fibers[0]] * 25
    large = replace(run, network=replace(run.network, fibers=fibers))
    assert "<details><summary>25 fibres</summary>" in _fibers(large)
    assert "<details><summary>4 fibres</summary>" in _fibers(run)
