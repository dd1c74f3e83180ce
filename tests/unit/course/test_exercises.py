"""The grading of the course: nothing is passed by an empty answer, or by a result without a run."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from course import exercises, verb
from course.exercises import COOKIE, EXERCISES, PORT, survives
from course.handed_in import HandedIn, Run
from qmn.__main__ import MODULES, described
from wire.metadata import header

ROOT = Path(__file__).resolve().parents[3]
RESULTS = ROOT / "tests" / "unit" / "qmn" / "results"
RIGHT = 0.75 * (1 - 0.99**6)
Change = Callable[[dict[str, Any]], object]


def run_of(folder: Path, name: str, change: Change = lambda _result: None) -> Run:
    """Return a run with a kept result, some of which is changed, and its captures."""
    result = json.loads((RESULTS / f"{name}_1.json").read_text())
    change(result)
    folder.mkdir()
    (folder / "result.json").write_text(json.dumps(result))
    captured = b"".join(
        header.HEADER.pack(header.MAGIC, header.VERSION, 1, 100, int(each, 16))
        for each in result["sessions"]["ids"]
    )
    (folder / "s1-eth1.pcap").write_bytes(b"\0" * 24 + captured)
    return Run(folder)


def long_and_noisy(result: dict[str, Any]) -> None:
    for fiber in result["network"]["fibers"]:
        fiber["depolarizing"] = 0.01
    result["job"]["asking"] |= {"delivered_bytes": 600, "bell_pairs": 6000}


def missing(number: int, work: HandedIn) -> list[str]:
    return [part.text for part in EXERCISES[number].check(work) if not part.done]


def test_a_run_and_the_right_answer_pass(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run", "sdc", long_and_noisy)
    assert missing(1, HandedIn([run], {"symbol_error_rate": RIGHT})) == []


@pytest.mark.parametrize("answers", [{}, {"symbol_error_rate": ""}, {"symbol_error_rate": 0.01}])
def test_no_answer_or_a_wrong_one_is_missing(tmp_path: Path, answers: dict[str, Any]) -> None:
    run = run_of(tmp_path / "run", "sdc", long_and_noisy)
    (part,) = missing(1, HandedIn([run], answers))
    assert part.startswith("symbol_error_rate: ")


def test_a_result_without_its_captures_is_no_run(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run", "sdc", long_and_noisy)
    (run.folder / "s1-eth1.pcap").write_bytes(b"")
    (part,) = missing(1, HandedIn([run], {"symbol_error_rate": RIGHT}))
    assert part == "run: a run of sdc with its captures"


@pytest.mark.parametrize("number", EXERCISES)
def test_runs_of_something_else_pass_no_exercise(number: int, tmp_path: Path) -> None:
    runs = [run_of(tmp_path / f"run{place}", "sdc") for place in range(EXERCISES[number].runs)]
    work = HandedIn(runs, {})
    assert len(missing(number, work)) >= 2
    assert missing(number, HandedIn(runs, {"why": "word " * 99, "qber": float("nan")}))


def test_eve_is_found_by_the_rate_that_she_makes(tmp_path: Path) -> None:
    tapped = run_of(tmp_path / "tapped", "qkd")
    whole = run_of(tmp_path / "whole", "qkd", without_eve)
    fraction = tapped.result.job.eve.fraction  # type: ignore[union-attr]
    answers = {"qber": fraction / 4, "least_fraction": 0.44}
    assert missing(3, HandedIn([tapped, whole], answers)) == []
    assert missing(3, HandedIn([whole, tapped], answers))
    (part,) = missing(3, HandedIn([tapped, whole], answers | {"least_fraction": 0.11}))
    assert part.startswith("least_fraction")


def without_eve(result: dict[str, Any]) -> None:
    result["job"]["eve"] = None
    result["job"]["asking"]["key_bits"] = 256


def flow_mod(cookie: int, match: bytes, instructions: bytes) -> bytes:
    """Return an ADD as OpenFlow 1.4 has it (specification, 7.3.4.2)."""
    padded = match + b"\0" * (-(len(match) + 4) % 8)
    body = cookie.to_bytes(8, "big") + bytes(8) + bytes(24 - 0)
    whole = body + b"\0\1" + (len(match) + 4).to_bytes(2, "big") + padded + instructions
    return b"\x05\x0e" + (len(whole) + 8).to_bytes(2, "big") + bytes(4) + whole


@pytest.mark.parametrize(
    ("cookie", "port", "instructions", "left"),
    [
        (COOKIE, PORT, b"", 0),
        (COOKIE, PORT, bytes(8), 1),
        (COOKIE, PORT + 1, b"", 1),
        (COOKIE + 1, PORT, b"", 3),
    ],
)
def test_the_app_s_entry_is_read_from_the_capture(
    tmp_path: Path, cookie: int, port: int, instructions: bytes, left: int
) -> None:
    run = run_of(tmp_path / "run", "sdc")
    match = b"\x80\x00\x0a\x02\x08\x00\x80\x00\x20\x02" + port.to_bytes(2, "big")
    message = flow_mod(cookie, match, instructions)
    (run.folder / "c0.pcap").write_bytes(b"frame" + message + message[:20])
    assert len(missing(2, HandedIn([run], {}))) == left


@pytest.mark.parametrize(
    ("between", "whole"),
    [
        ("12 23 34 41", True),
        ("12 23 34", False),
        ("12 12 23 23 34 34", False),  # both fibres of a way are cut together
        ("12 23 31 34 45 53", True),
        ("12 23 31 45 56 64", False),
        ("", False),
    ],
)
def test_a_network_survives_if_each_way_has_another(between: str, whole: bool) -> None:
    assert survives([(way[0], way[1]) for way in between.split()]) is whole


def test_its_verb_is_registered_from_outside_the_core(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert MODULES["course"] == verb.__name__
    assert described(["course"]).parse_args(["course", "list"]).call is verb.show
    arguments = described(["course"]).parse_args(["course", "check", "1"])
    assert arguments.call(arguments) == 1
    assert "missing  1 runs (--run), and there are 0" in capsys.readouterr().out
    arguments.run = [tmp_path]
    assert arguments.call(arguments) == 1
    assert "result.json" in capsys.readouterr().err


def test_each_exercise_has_its_page_and_solutions_are_in_no_package() -> None:
    for number, exercise in EXERCISES.items():
        text = (ROOT / "course" / exercise.page).read_text()
        assert text.startswith(f"# {number}. {exercise.title}\n")
        assert f"qmn course check {number} " in text
        for answer in ("symbol_error_rate", "qber", "least_fraction", "waited_ratio", "why"):
            asked = f'"{answer}' in source_of(exercise.check.__name__)
            assert not asked or f"`{answer}`" in text
    assert not list((ROOT / "course").rglob("*solution*"))


def source_of(name: str) -> str:
    text = Path(exercises.__file__).read_text()
    return text.partition(f"def {name}(")[2].partition("\ndef ")[0]
