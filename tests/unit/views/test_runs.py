"""The runs of a folder: listed, compared, pruned."""

import json
import subprocess
import time
from pathlib import Path
from random import Random
from typing import Any

import pytest
from runs_scene import NEW, OLD, called, change
from runs_scene import runs as runs

from qmn.__main__ import described
from qmn.results import schema
from topologies.system.namespaces import keeper
from topologies.system.processes.owners import namespace, owner
from views.archive import index as run_index
from views.archive.comparison import figures as compare_figures
from views.archive.comparison import moments as compare_moments
from views.archive.comparison import parameters as compare_parameters
from views.archive.index import INDEX, Run, runs_in
from views.live.layout import described as described_network
from views.report.run_facts import BadRun, read_result
from views.verbs import runs as verb
from views.verbs.live import shown
from wire.controller_lines import RECORD
from wire.malformed import MalformedPacket
from wire.results.run_result import BEGUN


def test_runs_are_listed_with_what_is_not_the_default(runs: Path) -> None:
    old, new = runs_in(runs)
    assert (old.name, old.began, old.what) == (OLD, "2026-01-01 10:00:00", "sdc chain")
    assert (old.outcome, new.outcome) == ("done", "not done")
    assert old.parameters == {"fec": "none <&>"}  # the loss budget and the port are as always
    change(runs / NEW, controller="os-ken", seed=2)
    (new,) = (run for run in runs_in(runs) if run.name == NEW)
    assert new.parameters == {"fec": "none <&>", "controller": "os-ken", "seed": 2}
    assert old.bytes == sum(file.stat().st_size for file in (runs / OLD).iterdir())


@pytest.mark.parametrize(
    ("service", "usual"),
    [
        ("keys", {"low_mark": 32, "key_protocol": "bb84", "keys_per_s": 0.0}),
        ("vpn", {"program": "wireguard", "rotate": 2.0, "mbit_s": 4.0}),
        ("netqasm", {"rounds": 1}),
    ],
)
def test_what_is_usual_of_a_job_is_not_listed(
    runs: Path, service: str, usual: dict[str, Any]
) -> None:
    """The values are those that `qmn run JOB --help` names as defaults."""
    change(runs / NEW, service=service, parameters=usual)
    (new,) = (run for run in runs_in(runs) if run.name == NEW)
    assert new.parameters == {}


def test_the_list_has_room_in_a_hundred_and_twenty_columns(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(runs / NEW, error=" ".join(["a_long_reason"] * 12), loss_budget_db=3.0, seed=2)
    assert called(runs) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 120
    assert " ".join(lines).count("a_long_reason") == 12  # nothing is cut
    old = next(line for line in lines if line.startswith(OLD))
    assert old[len(OLD) :].split()[:6] == ["01", "Jan", "10:00", "sdc", "chain", "fec"]


def test_a_result_that_has_changed_is_read_again_and_others_are_not(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs_in(runs)
    read = run_index.read_run
    seen: list[str] = []

    def noted(path: Path) -> Run:
        seen.append(path.name)
        return read(path)

    monkeypatch.setattr(run_index, "read_run", noted)
    change(runs / NEW, loss_budget_db=3.0)
    assert runs_in(runs)[1].parameters == {"fec": "none <&>", "loss_budget_db": 3.0}
    assert seen == [NEW]


@pytest.mark.parametrize("spoiled", [None, b"rubbish" * 1000, b""])
def test_an_index_that_is_lost_or_spoiled_is_made_anew(runs: Path, spoiled: bytes | None) -> None:
    before = runs_in(runs)
    (runs / INDEX).unlink()
    if spoiled is not None:
        (runs / INDEX).write_bytes(spoiled)
    assert runs_in(runs) == before
    assert (runs / INDEX).stat().st_size > 0


def test_a_run_without_a_result_is_listed_as_such(runs: Path) -> None:
    (runs / NEW / "result.json").unlink()
    assert [run.outcome for run in runs_in(runs)] == ["done", "no result"]


@pytest.mark.parametrize(
    ("result", "why"),
    [
        ("[" * 200_000, "is not JSON"),
        ("[" * 33 + "]" * 33, "deeper than 32"),
        ("", "is not JSON"),
        ('"text"', "neither an object nor a list"),
        ("[]", "the result: [] is not object"),
        ('{"parameters": 5}', "the result.parameters: 5 is not object"),
        ('{"parameters": {"fec": {}}}', "{} is none of bool, int, float, str"),
        ('{"service": ["x"]}', "the result.service: ['x'] is none of str"),
        ('{"delivered": 1}', "the result.delivered: 1 is none of bool"),
        ('{"seed": true}', "the result.seed: True is none of int"),
        ('{"error": "\\ud800"}', "is none of str"),
        ('{"seed": 1' + "0" * 400 + "}", "is none of int"),
    ],
)
def test_a_result_that_is_none_is_listed_as_not_readable(
    runs: Path, capsys: pytest.CaptureFixture[str], result: str, why: str
) -> None:
    (runs / NEW / "result.json").write_text(result)
    old, new = runs_in(runs)
    assert old.outcome == "done"
    assert new.outcome.startswith("not readable: ")
    assert why in new.outcome
    assert called(runs) == 0
    assert called(runs, "compare", OLD, NEW) == 1
    assert called(runs, "prune", "--older-than", "1h", "--dry-run") == 0
    output = capsys.readouterr()
    assert f"would remove {NEW}" in output.out
    assert output.err.startswith("qmn: ")
    with pytest.raises(BadRun):
        read_result(runs / NEW)


def test_a_result_that_cannot_be_opened_is_listed_as_not_readable(runs: Path) -> None:
    (runs / NEW / "result.json").unlink()
    (runs / NEW / "result.json").mkdir()
    assert "not readable: [Errno 21] Is a directory" in runs_in(runs)[1].outcome


@pytest.mark.parametrize("name", ["20261399T100000-x", "20260101T250000-x", "00000101T100000-x"])
def test_a_folder_without_a_time_of_this_calendar_is_no_run(runs: Path, name: str) -> None:
    (runs / name).mkdir()
    assert [run.name for run in runs_in(runs)] == [OLD, NEW]


SPOILED: tuple[Any, ...] = (
    None,
    True,
    -1,
    10**30,
    1e308,
    float("nan"),
    "",
    "a b",
    [],
    ["x"],
    {},
    {"a": 1},
    [[]],
)


def spoiled(given: Any, random: Random) -> Any:
    """Return decoded JSON in which one part is another, or missing."""
    if not isinstance(given, dict | list) or not given or random.random() < 0.1:
        return random.choice(SPOILED)
    place: Any = random.choice([*given] if isinstance(given, dict) else range(len(given)))
    copy: Any = given.copy()
    if random.random() < 0.1:
        del copy[place]
    else:
        copy[place] = spoiled(copy[place], random)
    return copy


@pytest.mark.by_day(every=5)
@pytest.mark.parametrize("part", range(10))
def test_a_spoiled_result_is_read_whole_or_refused(runs: Path, part: int) -> None:
    good = json.loads((runs / OLD / "result.json").read_text())
    random, refused = Random(part), 0
    for _ in range(100):
        (runs / NEW / "result.json").write_text(json.dumps(spoiled(good, random)))
        run_index.read_run(runs / NEW)
        try:
            _result, network = read_result(runs / NEW)
            described_network(network)
            compare_parameters(runs / OLD, runs / NEW)
            compare_figures(runs / OLD, runs / NEW)
        except (BadRun, MalformedPacket):
            refused += 1
    assert 50 < refused < 100


def test_what_happened_first_is_told_from_the_first_set_up_on(runs: Path) -> None:
    """Of both runs everything is in ms since then, and what one lacks is a dash."""
    lines = (runs / OLD / RECORD).read_text().splitlines()
    begins_ns = json.loads(lines[0])["time_ns"]
    for event, later_ms in (("granted", 2), ("refused", 3), ("torn_down", 5), ("refused", 9)):
        lines.append(json.dumps({"event": event, "time_ns": begins_ns + later_ms * 1_000_000}))
    (runs / OLD / RECORD).write_text("\n".join(lines) + "\n")
    rows = {name: (ours, theirs) for name, ours, theirs in compare_moments(runs / OLD, runs / NEW)}
    origin_ms = float(rows["granted"][0]) - 2
    for name, later_ms in (("granted", 2), ("refused", 3), ("torn down", 5)):
        assert rows[name] == (f"{origin_ms + later_ms:.3f}", "-")
    assert rows["open"] == ("0.000", "0.000")


def runner_of(kind: str) -> str:
    """Return a process that runs, or one that has ended, as a run names its own."""
    if kind == "there":
        return keeper()
    with subprocess.Popen(["sleep", "60"]) as process:
        gone = f"{namespace()}.{owner(process.pid)}"
        process.kill()
    return gone


@pytest.mark.parametrize(
    ("runner", "outcome", "what"),
    [("gone", "not done: its runner was killed", "sdc chain"), ("there", "goes on", "chain-1")],
)
def test_a_run_whose_runner_was_killed_is_listed_with_what_it_was(
    runs: Path, runner: str, outcome: str, what: str
) -> None:
    run = runs / NEW
    begun = schema.read_left(run)
    (run / "result.json").unlink()
    begun.write_begun(run, runner_of(runner))
    (found,) = (each for each in runs_in(runs) if each.name == NEW)
    assert (found.outcome, found.what) == (outcome, what)
    if runner == "gone":
        assert read_result(run)[0].error == "its runner was killed"
        assert found.parameters == {"fec": "none <&>"}
    else:
        with pytest.raises(BadRun, match="name the folder of a run that has ended"):
            read_result(run)
    begun.write(run)  # it goes on after all, and ends
    assert [each.outcome for each in runs_in(runs)] == ["done", "not done"]
    assert not (run / BEGUN).exists()


def test_the_page_of_a_run_whose_runner_was_killed_says_so(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = runs / NEW
    begun = schema.read_left(run)
    with shown(run, read_only=True) as view:
        assert view.over == "a run that is over"
    assert capsys.readouterr().err == ""
    (run / "result.json").unlink()
    begun.write_begun(run, runner_of("gone"))
    with shown(run, read_only=True) as view:
        assert view.over == "a run that is over: its runner was killed"
        assert not view.live
    assert "its runner was killed: the page shows what was there" in capsys.readouterr().err


def test_a_run_that_has_gone_leaves_the_list(runs: Path) -> None:
    runs_in(runs)
    (runs / NEW).rename(runs.parent / "elsewhere")
    assert [run.name for run in runs_in(runs)] == [OLD]


def test_two_runs_are_compared(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change(runs / NEW, loss_budget_db=3.0, controller="os-ken", topology="ring", service="teleport")
    assert called(runs, "compare", OLD, "latest") == 0
    output = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["service", "sdc", "teleport"] in output
    assert ["topology", "chain", "ring"] in output
    assert ["controller", "ryu", "os-ken"] in output
    assert ["loss", "budget", "db", "30", "3"] in output
    assert ["asking", "bell", "pairs", "100", "100"] in output
    assert ["bell-measure", "3.000", "3.000"] in output  # 5 ms, and paths opened at 2 ms
    assert not any(words[:1] == ["fec"] for words in output)


def test_runs_that_have_sent_different_bytes_differ(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The digests are those of `sha256sum` of "one" and "two"."""
    digests = {
        OLD: "7692c3ad3540bb803c020b3aee66cd8887123234ea0c6e7143c0add73ff431ed",
        NEW: "3fc4ccfe745870e2c0d99f71f30ff0656c8dedd41cc1d7d3d376b0dbe685e2f3",
    }
    for run, digest in digests.items():
        job = json.loads((runs / run / "result.json").read_text())["job"]
        sent = {"file": "message", "bytes": 3, "sha256_sent": digest, "sha256_received": digest}
        change(runs / run, job={**job, "message": sent})
    assert called(runs, "compare", OLD, NEW) == 0
    output = [line.split() for line in capsys.readouterr().out.splitlines()]
    first, second = (["3", "bytes,", "SHA-256", digest[:12]] for digest in digests.values())
    assert ["message", *first, *second] in output
    assert called(runs, "compare", OLD, OLD) == 0
    assert "SHA-256" not in capsys.readouterr().out


def test_what_cannot_be_compared_is_named(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert called(runs, "compare", OLD, "nothing") == 1
    assert f"there is no run 'nothing': choose one of {NEW}, {OLD}" in capsys.readouterr().err
    (runs / OLD / "result.json").unlink()
    assert called(runs, "compare", OLD, NEW) == 1
    assert f"{OLD}: no result of a run" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("older_than_s", "keep_gb", "doomed"),
    [
        (None, None, []),
        (150.0, None, ["a"]),
        (50.0, None, ["a", "b"]),
        (None, 3e-9, []),
        (None, 2.5e-9, ["a"]),
        (None, 0.0, ["a", "b", "c"]),
        (150.0, 1e-9, ["a", "b"]),
    ],
)
def test_the_oldest_are_pruned(
    older_than_s: float | None, keep_gb: float | None, doomed: list[str]
) -> None:
    """Three runs of a byte, 200, 100 and 0 s old."""
    began = ["2026-01-01 10:00:00", "2026-01-01 10:01:40", "2026-01-01 10:03:20"]
    listed = [
        Run(name, 1, moment, "", "{}", "done", 1) for name, moment in zip("abc", began, strict=True)
    ]
    now = time.mktime(time.strptime(began[2], "%Y-%m-%d %H:%M:%S"))
    assert [run.name for run in verb.to_prune(listed, older_than_s, keep_gb, now)] == doomed


def test_pruning_removes_runs_and_nothing_else(runs: Path) -> None:
    assert called(runs, "prune", "--keep-gb", "0", "--dry-run") == 0
    assert {path.name for path in runs.iterdir()} == {OLD, NEW, "latest", "notes", INDEX}
    (runs / OLD / "result.json").unlink()  # has changed now: it may go on
    assert called(runs, "prune", "--keep-gb", "0") == 0
    assert {path.name for path in runs.iterdir()} == {OLD, "notes", INDEX}


def test_a_prune_of_everything_is_not_guessed(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(runs, "prune") == 1
    assert "--older-than 30d" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        called(runs, "prune", "--older-than", "3")


def test_where_no_folder_of_runs_is_the_remedy_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = tmp_path / "nowhere"
    arguments = described(["runs"]).parse_args(["runs", "--runs", str(nowhere)])
    assert arguments.call(arguments) == 1
    words = f"qmn: no runs yet: {nowhere} does not exist; make a run with `qmn run sdc`, or name"
    assert capsys.readouterr().err.startswith(words)
