"""Requests of jobs: filled by words or by keywords, and kept in results."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from json_schema import problems
from recorded_run import asked

from applications.keys.request import KeysRequest
from applications.netqasm import verb as netqasm
from applications.vpn.request import VpnRequest
from evidence.traffic.request import LoadRequest
from qmn.__main__ import described
from qmn.network.options import NetworkOptions
from qmn.options import BadInput, from_keywords, read
from qmn.requests.kinds import RECORDED_REQUESTS
from qmn.requests.recording import recorded
from qmn.requests.request import Request
from qmn.requests.service import service_request
from qmn.requests.superdense import superdense_request
from qmn.results import schema
from qmn.results.artifacts import beginning
from qmn.verbs import run
from wire.malformed import MalformedPacket

ROOT = schema.json_schema()
READERS = {
    "sdc": run.superdense_request,
    "load": partial(read, LoadRequest),
    "keys": partial(read, KeysRequest),
    "vpn": partial(read, VpnRequest),
}


def parse(*words: str) -> Request:
    """Return what a command line asks for."""
    arguments = described([*words]).parse_args([*words])
    if words[0] == "netqasm":
        return netqasm.request_of(arguments)
    reader: Any = READERS.get(words[1], run.service_request)
    request: Request = reader(arguments)
    return request


SAME = [
    (
        "run sdc --from bob --to alice --fec golay --interleave --length-km 2 --fiber drift_hz=1",
        superdense_request(
            sender="bob",
            receiver="alice",
            fec="golay",
            interleave=True,
            length_km=2,
            fiber=["drift_hz=1"],
        ),
    ),
    (
        "run qkd --protocol e91 --count 500 --rate-hz 7 --eve 1 --seed 3 --captures none --runs /r",
        service_request(
            "e91", count=500, rate_hz=7, eve=1, seed=3, captures="none", runs=Path("/r")
        ),
    ),
    ("run ghz --line c,a,b", service_request("ghz", line="c,a,b")),
    (
        "run keys --key-pair a:b --eve 0.5 --until 20 --keys here --seconds 9",
        from_keywords(
            KeysRequest,
            {"key_pair": ["a:b"], "eve": 0.5, "until": 20, "keys": "here", "seconds": 9},
            topology="sdc",
        ),
    ),
    (
        "run vpn --with tls --rotate 3 --classical-mbps 5",
        from_keywords(
            VpnRequest,
            {"program": "tls", "rotate": 3, "classical_mbps": 5},
            topology="sdc",
        ),
    ),
    (
        "run load --service teleport --file m.csv --constant --policy p.toml",
        from_keywords(
            LoadRequest,
            {"service": "teleport", "file": "m.csv", "constant": True, "policy": "p.toml"},
            topology="ring",
        ),
    ),
]


@pytest.mark.parametrize(("words", "request_"), SAME, ids=lambda each: str(each)[:12])
def test_keywords_ask_for_what_the_command_line_does(words: str, request_: Request) -> None:
    assert parse(*words.split()) == request_


def test_a_keyword_that_there_is_not_is_refused_by_name() -> None:
    with pytest.raises(BadInput, match=r"no option lenght_km: did you mean length_km\?"):
        superdense_request(lenght_km=2.0)
    with pytest.raises(BadInput, match="there is no option fec: "):
        service_request("teleport", fec="golay")
    with pytest.raises(BadInput, match="there is no option phases_rad: "):
        service_request("sense", phases_rad=(1.0,))
    with pytest.raises(BadInput, match=r"fec 'gold': did you mean golay\?"):
        superdense_request(fec="gold")


# A job of each kind, with options that are not as always, and what a result keeps of these.
JOBS: list[tuple[str, str, dict[str, Any]]] = [
    ("sdc", "run sdc --fec golay --length-km 2", {"fec": "golay", "length_km": 2.0}),
    ("distribute", "run distribute --rounds 2 --node ion-trap", {"node": ["ion-trap"]}),
    ("mdi", "run qkd --protocol mdi --eve 0.5", {"eve": 0.5, "eve_attack": "resend"}),
    ("sense", "run sense --probes separate", {"probes": "separate", "sender": "alice"}),
    ("seal", "run seal --missed 0.1 --classical-mbps 2", {"missed": 0.1, "classical_mbps": 2.0}),
    ("keys", "run keys --key-pair a:b --eve 1", {"key_pair": ["a:b"], "eve": 1.0, "at": 10.0}),
    ("vpn", "run vpn --rotate 3", {"program": "wireguard", "rotate": 3.0}),
    ("load", "run load --service ghz --file m.csv", {"service": "ghz", "file": "m.csv"}),
    ("netqasm", "netqasm /app --rounds 3", {"application": "/app", "rounds": 3}),
]


@pytest.mark.parametrize(("job", "words", "report"), JOBS, ids=[job for job, *_rest in JOBS])
def test_what_a_result_keeps_fits_its_schema_and_is_read_back(
    job: str, words: str, report: dict[str, Any]
) -> None:
    request = parse(*words.split())
    parameters = json.loads(json.dumps(recorded(request)))
    assert report.items() <= parameters.items()
    place = ROOT["$defs"][f"parameters of {job}"]
    assert problems(parameters, place, ROOT) == []
    again = asked(job, parameters)
    assert type(again) is type(request)
    assert recorded(again) == recorded(request)
    assert (again.network.fiber, again.run.classical_mbps) == (
        request.network.fiber,
        request.run.classical_mbps,
    )


def test_what_means_nothing_is_not_kept() -> None:
    """Of an eavesdropper who is not there, of the run's files, of what a result tells beside."""
    parameters = recorded(parse("run", "keys", "--seed", "7", "--metrics", "--without", "events"))
    named = {"eve", "at", "until", "seed", "metrics", "events", "keys", "controller", "place"}
    assert not parameters.keys() & named


@pytest.mark.parametrize("job", RECORDED_REQUESTS)
def test_no_result_has_parameters_of_another_job(job: str) -> None:
    with pytest.raises(MalformedPacket, match="parameters has no luck: "):
        asked(job, {"luck": 1})
    place = ROOT["$defs"][f"parameters of {job}"]
    assert any("/luck is unknown" in each for each in problems({"luck": 1}, place, ROOT))


def test_a_result_of_a_network_keeps_all_of_its_options_that_say_something(tmp_path: Path) -> None:
    options = NetworkOptions(seed=7, controller="os-ken", length_km=2.0, time="paced=40")
    facts = beginning(options)
    facts.write(tmp_path)
    left = json.loads((tmp_path / "result.json").read_text())
    assert problems(left, ROOT["$defs"]["NetworkResult"], ROOT) == []
    assert schema.read_left(tmp_path).parameters == options
    spoiled = {**left, "parameters": {**left["parameters"], "luck": 1}}
    with pytest.raises(MalformedPacket, match="luck"):
        schema.of_either_kind(spoiled)
