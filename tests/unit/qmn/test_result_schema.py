"""result.json has one schema, which docs/ has as a file."""

import json
from dataclasses import MISSING, fields
from pathlib import Path
from types import UnionType
from typing import Any, cast, get_args, get_origin, get_type_hints

import pytest
from json_schema import problems
from recorded_run import record_run, service_run, teleported

from qmn.results import schema
from qmn.results.result import complete
from qmn.results.run_result import RunResult
from topologies.system.processes.programs import ROOT
from wire.malformed import MalformedPacket
from wire.parameters.fiber import FiberOptics
from wire.parameters.physics import Detectors, Device, Memory, PairSource, Sensor
from wire.results.figures import Figures, PairFigures
from wire.results.service_figures import ServiceFigures
from wire.results.time_series import (
    ClosedMoment,
    EveComes,
    EveLeaves,
    FileMoment,
    HandshakeMoment,
    KeyMoment,
    Moment,
    NoKeyMoment,
    SessionMoment,
    figures,
    moment,
)
from wire.typed_json import read

FILE = ROOT / "docs" / "result.schema.json"


def wrong(result: dict[str, Any]) -> list[str]:
    """Return what of a result does not fit the schema in docs/."""
    root = json.loads(FILE.read_text())
    return problems(result, root, root)


def of_message(folder: Path) -> dict[str, Any]:
    """Return the result of a recorded run, whatever is known only of a network that has run."""
    result: dict[str, Any] = json.loads((record_run(folder) / "result.json").read_text())
    return result


def test_the_schema_in_docs_is_that_of_the_code() -> None:
    """Made by: python -m qmn.results.schema > docs/result.schema.json."""
    assert FILE.read_text() == schema.text()


def test_the_result_of_a_message_fits(tmp_path: Path) -> None:
    assert wrong(of_message(tmp_path)) == []


def test_fibres_and_devices_are_read_back_as_they_were(tmp_path: Path) -> None:
    """Of devices the file has what is not ideal: an efficiency of 0.8, and not one of 1."""
    left = of_message(tmp_path)
    assert left["devices"] == {"every": {}, "bob": {"detectors": {"efficiency": 0.8}}}
    again = schema.read_left(tmp_path)
    assert isinstance(again, RunResult)
    assert again.every_fiber == FiberOptics(length_km=5.0)
    bob = Device(detectors=Detectors(efficiency=0.8))
    assert again.devices == {"every": Device(), "bob": bob}


def test_a_device_is_told_by_what_is_not_ideal_and_made_of_that_again() -> None:
    source = PairSource("poisson", 0.4, decoys=(0.1, 0.0), bell_diagonal=(0.7, 0.1, 0.1, 0.1))
    device = Device(source, Memory(t1_s=2.0, noise_parameters={"a": [1]}), sensor=Sensor(0.5))
    content = json.loads(json.dumps(device.to_dict()))
    assert content == {
        "source": {
            "statistics": "poisson",
            "mean_pairs": 0.4,
            "bell_diagonal": [0.7, 0.1, 0.1, 0.1],
            "decoys": [0.1, 0.0],
        },
        "memory": {"t1_s": 2.0, "noise_parameters": {"a": [1]}},
        "sensor": {"phase_rad": 0.5},
    }
    assert read(Device, content) == device
    root = schema.json_schema()
    assert problems(content, root["$defs"]["Device"], root) == []


def test_the_result_of_a_service_fits(tmp_path: Path) -> None:
    complete(service_run(teleported(fidelity=None)), tmp_path)
    assert wrong(json.loads((tmp_path / "result.json").read_text())) == []


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"pairs_made": 7.5}, "/pairs_made: 7.5 is not of type integer"),
        ({"delivered": 1}, "/delivered: 1 is not of type boolean"),
        ({"sessions": {"granted": 1, "refused": 0, "ids": [7]}}, "/sessions/ids/0: 7 is not"),
        ({"pair_made": 7}, "/pair_made is unknown"),
        ({"job": {"asking": {}, "asked": {}, "message": None}}, "/job/eve is missing"),
        ({"path_setup_ms": {"p50": 1.0, "n": 1}}, "/path_setup_ms/p99 is missing"),
    ],
)
def test_what_does_not_fit_is_noticed(tmp_path: Path, change: dict[str, Any], text: str) -> None:
    (found,) = wrong({**of_message(tmp_path), **change})
    assert text in found


def test_a_result_without_what_every_run_says_does_not_fit(tmp_path: Path) -> None:
    result = of_message(tmp_path)
    for name in ("seed", "service", "backend", "emulation"):
        assert wrong({each: value for each, value in result.items() if each != name})


def of_services() -> list[type[Figures]]:
    return [kind for kind in get_args(ServiceFigures) if kind is not Figures]


@pytest.mark.parametrize("kind", of_services())
@pytest.mark.parametrize("whole", [False, True])
def test_figures_are_read_back_as_those_of_their_service(kind: Any, whole: bool) -> None:
    """By their names alone, also where a session has not come to all of them."""
    names = [each.name for each in fields(kind) if whole or each.default is MISSING]
    hints = get_type_hints(kind)
    read = figures({"event": "done", **{name: some(hints[name]) for name in names}})
    assert (type(read), list(vars(read))) == (kind, names)


def some(hint: Any) -> Any:
    """Return a value of a figure's type."""
    kind = (get_args(hint) or (hint,))[0] if isinstance(hint, UnionType) else hint
    return (get_origin(kind) or kind)()


SESSION = {"peer": "bob", "opened": True, "keys": 0, "qber": None, "mine": 3, "theirs": 4}
EVE = {"attack": "resend", "fraction": 0.5, "blocks": 3, "photons": 90, "lost_blocks": 0}


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ({"event": "session", **SESSION, "withheld": False}, SessionMoment),
        ({"event": "alarm", **SESSION, "withheld": True, "text": "why"}, SessionMoment),
        ({"event": "key", "key_ID": "1"}, KeyMoment),
        ({"event": "handshake", "key_ID": "1", "seconds": 0.1}, HandshakeMoment),
        ({"event": "tunnel_opened"}, Moment),
        ({"event": "tunnel_closed", "key_age_s": 5.0}, ClosedMoment),
        ({"event": "no_key", "text": "why"}, NoKeyMoment),
        ({"event": "received", "bytes": 7}, FileMoment),
        ({"event": "downloaded", "bytes": 7, "sha256": "ab"}, FileMoment),
        ({"event": "eve_comes", "fraction": 0.5}, EveComes),
        ({"event": "eve_leaves", **EVE, "measured": 9}, EveLeaves),
        ({"event": "eve_leaves"}, Moment),
    ],
)
def test_moments_are_read_as_what_they_are_of(line: dict[str, Any], kind: type[Moment]) -> None:
    """As key managers, ends of tunnels and downloads print them, and kept as they were."""
    happened = moment({**line, "host": "alice"}, 1.23456)
    assert type(happened) is kind
    assert vars(happened) == {**line, "host": "alice", "at": 1.235}
    root = schema.json_schema()
    assert problems(vars(happened), root["$defs"][kind.__name__], root) == []


def test_moments_that_no_program_tells_are_refused() -> None:
    with pytest.raises(MalformedPacket, match="is none of Moment, SessionMoment"):
        moment({"event": "key", "luck": 1}, 1.0)


def test_figures_that_no_service_has_are_refused() -> None:
    for report in ({"luck": 1}, {"states": 7}, {**vars(teleported()), "luck": 1}):
        with pytest.raises(MalformedPacket, match=r"none of Figures, .*TeleportFigures"):
            figures(report)
    with pytest.raises(TypeError, match="TeleportFigures has no luck"):
        teleported(luck=1)


def test_figures_that_are_not_told_are_not_in_the_result(tmp_path: Path) -> None:
    """Of pairs that have waited for nothing there is no wait: it is not 0, and not unknown."""
    names = [each.name for each in fields(cast("Any", PairFigures)) if each.default is MISSING]
    reports: PairFigures = cast("Any", PairFigures)(**dict.fromkeys(names, 1), dropped=3)
    complete(service_run(reports), tmp_path)
    asking = json.loads((tmp_path / "result.json").read_text())["job"]["asking"]
    assert asking == {**dict.fromkeys(names, 1), "dropped": 3}
    assert (reports.dropped, reports.attempts, reports.waited_ms) == (3, 0, None)
