"""Results of every schema are read, those of a newer one refused; the page says the versions."""

import json
from pathlib import Path
from typing import Any

import pytest

from qmn.network.options import GONE
from qmn.results.schema import FIELDS, of_either_kind, read_run
from wire import events
from wire.malformed import MalformedPacket
from wire.metadata import header
from wire.results.run_result import SCHEMA, KeysJob
from wire.results.schema import head_of

# qkd_1 is of a service that applications register.
KEPT_IN = Path(__file__).parent / "results"
KEPT = sorted(KEPT_IN.glob("*.json"))
PAGE = (Path(__file__).resolve().parents[3] / "docs" / "versions.md").read_text()


def given(file: Path) -> Any:
    return json.loads(file.read_text())


@pytest.mark.parametrize("file", KEPT, ids=[file.stem for file in KEPT])
def test_a_result_of_an_earlier_version_is_read_whole(file: Path) -> None:
    content = given(file)
    read = of_either_kind(content)
    assert read.schema == int(file.stem.rpartition("_")[2])
    assert (read.seed, read.topology) == (content["seed"], content["topology"])
    asked = {name: value for name, value in content["parameters"].items() if name not in GONE}
    assert read.recorded_parameters.items() >= asked.items()
    assert read.network is not None
    assert [each.length_km for each in read.network.fibers] == [
        each["length_km"] for each in content["network"]["fibers"]
    ]
    for name, value in content["job"]["asking"].items():
        assert getattr(read.asking, FIELDS.get(name, name)) == value  # type: ignore[attr-defined]


def test_results_of_earlier_names_are_read_whole() -> None:
    seal, keys = (given(KEPT_IN / f"{name}_1.json") for name in ("seal", "keys"))
    watched, asking = read_run(seal).watched, seal["job"]["asking"]
    assert watched is not None
    assert (watched.monitors, watched.preempted) == (1, 0)
    assert asking["given_back"] is False
    job, events = read_run(keys).job, [each["event"] for each in keys["job"]["moments"]]
    assert isinstance(job, KeysJob)
    assert [each.event for each in job.time_series] == events


def test_there_are_results_of_every_schema() -> None:
    assert {int(file.stem.rpartition("_")[2]) for file in KEPT} == set(range(SCHEMA + 1))


@pytest.mark.parametrize("number", [SCHEMA + 1, 1e9, "1", None])
def test_a_result_of_a_newer_schema_is_refused_with_both_numbers(number: object) -> None:
    content = {**given(KEPT[0]), "schema": number}
    with pytest.raises(MalformedPacket, match=f"has schema .* reads up to {SCHEMA}: read it by"):
        head_of(content)


def test_the_page_has_the_versions_of_the_formats() -> None:
    assert f"third byte of the header | {header.VERSION} |" in PAGE
    assert f"third byte of each record | {events.VERSION} |" in PAGE
    assert f"field `schema` | {SCHEMA} |" in PAGE
