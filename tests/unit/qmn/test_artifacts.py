"""The files of `qmn cli` and scripts in their folder, also where the network failed."""

import json
from pathlib import Path
from typing import Any

import pytest

from dispatcher.layer.history import EventCapture
from qmn.network.options import NetworkOptions
from qmn.results.artifacts import artifacts_of
from qmn.results.timeline import TIMELINE
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.dissection.dissectors import SCRIPT, script
from views.report.report_file import NoReport, made_report
from wire.controller_lines import EARLIER, RECORD
from wire.dispatcher_pb2 import Event
from wire.leaps import LEAPS
from wire.results.run_result import RESULT, NetworkFacts

OPTIONS = NetworkOptions(seed=7, length_km=2.0, fiber=("filter_nm=2",))


def result(folder: Path) -> dict[str, Any]:
    facts: dict[str, Any] = json.loads((folder / RESULT).read_text())
    return facts


def test_parameters_seed_and_timeline_are_left(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    with artifacts_of(OPTIONS, folder) as facts:
        facts.network = NetworkFacts({"bob": "10.0.0.2"}, "bob", [], [], [])
        with (folder / EVENT_CAPTURE).open("wb") as opened:
            EventCapture(opened, []).record(Event(time_ns=10**18, node="bob", kind="create"))
    left = result(folder)
    assert (left["seed"], left["controller"], left["topology"]) == (7, "ryu", None)
    assert left["parameters"]["length_km"] == 2
    assert left["parameters"]["fiber"] == ["filter_nm=2"]
    assert left["network"] == facts.network.to_dict()
    assert left["timeline"] == str(folder / TIMELINE)
    assert (folder / TIMELINE).stat().st_size > 0
    assert (folder / SCRIPT).read_text() == script()
    with pytest.raises(NoReport, match="only `qmn run` has a report"):
        made_report(folder)


def test_captures_of_an_earlier_network_are_not_taken_for_this_ones(tmp_path: Path) -> None:
    earlier = (RECORD + EARLIER, "s1-eth1.pcap", LEAPS, TIMELINE)
    for name in (RECORD, *earlier):
        (tmp_path / name).write_text("earlier")
    with artifacts_of(OPTIONS, tmp_path):
        pass
    assert result(tmp_path)["captures"] == []
    assert not [name for name in earlier if (tmp_path / name).exists()]


def test_what_is_in_a_folder_without_a_network_stays(tmp_path: Path) -> None:
    (tmp_path / "mine.pcap").write_text("mine")
    with artifacts_of(OPTIONS, tmp_path):
        pass
    assert (tmp_path / "mine.pcap").read_text() == "mine"


def die_in(folder: Path) -> None:
    with artifacts_of(OPTIONS, folder):
        assert not (folder / RESULT).exists()
        raise NetworkError("q1 died in mid-run")


def test_the_result_of_an_earlier_network_is_gone_while_another_runs(tmp_path: Path) -> None:
    (tmp_path / RESULT).write_text("{}")
    with pytest.raises(NetworkError):
        die_in(tmp_path)
    left = result(tmp_path)
    assert left["error"] == "q1 died in mid-run"
    assert left["timeline"].startswith("not made: no captures")


def test_without_a_folder_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with artifacts_of(OPTIONS, None) as facts:
        facts.network = NetworkFacts({"bob": "10.0.0.2"}, "bob", [], [], [])
    assert list(tmp_path.iterdir()) == []
