"""Settings of devices that a job would not feel are refused by name, with the one that acts."""

import re
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from applications.vpn import job as vpn
from applications.vpn.request import VpnRequest
from controller_apps import policy
from evidence.traffic import job as load
from evidence.traffic.request import LoadRequest
from qmn.__main__ import described
from qmn.jobs.counted_service import checked
from qmn.options import BadInput, from_keywords
from qmn.requests.service import service_request
from topologies.chain import ChainTopo
from topologies.nodes.optical_switch import OpticalSwitch

POLICY = Path(policy.__file__).with_name("demo.toml")
FIDELITY, WRONG = "source.fidelity=0.9", "source.preparation_error=0.1"
MADE_WRONG = "gates.initialization_error=0.1"
SEPARATE = {"probes": "separate"}
DIAGONAL = "source.bell_diagonal=[0.7, 0.1, 0.1, 0.1]"

BLIND_ALLEYS = {"topology": f"{__file__}:BlindAlleys"}


class BlindAlleys(ChainTopo):
    """Of charlie, and of the quantum switch q3."""

    def build(self, switches: int = 2, fibers: int = 1, **fiber: Any) -> None:
        super().build(switches, fibers, **fiber)
        self.setNodeInfo("q1", {**self.nodeInfo("q1"), "analysers": 1})
        self.addSwitch("q3", cls=OpticalSwitch)
        self.addLink("s1", "q3")
        self.join("q3", "q2", 1)


def check(service: str, *words: str, **options: Any) -> None:
    """Check a request with these words of --device."""
    checked(service_request(service, device=list(words), **options))


@pytest.mark.parametrize(
    ("service", "word", "options", "refusal"),
    [
        ("bb84", f"alice.{FIDELITY}", {}, "give alice.source.preparation_error"),
        ("bb84", f"alice.{DIAGONAL}", {}, "bb84 does not use bell_diagonal of alice's source"),
        ("bb84", f"bob.{FIDELITY}", {}, "bb84 does not use the source of bob"),
        ("mdi", f"bob.{FIDELITY}", {}, "give bob.source.preparation_error"),
        ("teleport", f"alice.{FIDELITY}", {}, "give alice.source.preparation_error"),
        (
            "bbm92",
            f"alice.{FIDELITY}",
            {},
            "does not use the source of alice: give it for charlie",
        ),
        ("bbm92", f"charlie.{WRONG}", {}, "give charlie.source.fidelity"),
        (
            "distribute",
            f"charlie.{WRONG}",
            {},
            "does not use preparation_error of charlie's",
        ),
        (
            "distribute",
            f"alice.{MADE_WRONG}",
            {},
            "does not use initialization_error of alice's gates",
        ),
        (
            "sense",
            f"alice.{MADE_WRONG}",
            {},
            "does not use initialization_error of alice's gates",
        ),
        (
            "sense",
            f"alice.{FIDELITY}",
            {"probes": "separate"},
            "give alice.source.preparation_error",
        ),
        ("sense", f"alice.{WRONG}", {}, "give alice.source.fidelity"),
        (
            "ghz",
            f"charlie.{FIDELITY}",
            {},
            "does not use the source of charlie: give it for alice",
        ),
        ("swap", f"charlie.{FIDELITY}", {}, "charlie takes no part in swap: give it for alice"),
        ("bb84", f"charlie.{FIDELITY}", {}, "charlie takes no part in bb84: leave it out"),
        ("bb84", "alice.sensor.phase_rad=1", {}, "bb84 does not use the sensor of alice"),
        ("bb84", "alice.memory.t2_s=1", {}, "use the memory of alice: give it for bob"),
        ("distribute", "alice.emitter.efficiency=0.5", {}, "the emitter of alice: leave it out"),
    ],
)
def test_a_setting_that_does_nothing_in_a_job_is_refused(
    service: str, word: str, options: dict[str, Any], refusal: str
) -> None:
    with pytest.raises(BadInput) as refused:
        check(service, word, **options)
    assert str(refused.value).startswith(f"--device {word}: ")
    assert refusal in str(refused.value)


@pytest.mark.parametrize(
    ("service", "word", "options"),
    [
        ("bb84", f"alice.{WRONG}", {}),
        ("bbm92", f"charlie.{FIDELITY}", {}),
        ("e91", f"charlie.{DIAGONAL}", {}),
        ("teleport", f"alice.{WRONG}", {}),
        ("teleport", f"charlie.{FIDELITY}", {}),
        ("distribute", f"alice.{FIDELITY}", {"source": "alice"}),
        ("sense", f"bob.{WRONG}", {"probes": "separate"}),
        ("ghz", f"alice.{FIDELITY}", {}),
        ("swap", f"alice.{FIDELITY}", {}),
        ("swap", f"bob.{FIDELITY}", {}),
        ("distribute", "bob.source.statistics=none", {"node": ["ion-trap"]}),
        ("bb84", f"charlie.{FIDELITY}", {"policy": str(POLICY)}),  # that may have fibres watched
    ],
)
def test_a_setting_that_acts_is_taken(service: str, word: str, options: dict[str, Any]) -> None:
    check(service, word, **options)


@pytest.mark.parametrize("word", [f"alice.{FIDELITY}", f"bob.{DIAGONAL}", f"bob.{MADE_WRONG}"])
def test_keys_of_a_vpn_refuse_what_bb84_does_not_feel(word: str) -> None:
    with pytest.raises(BadInput) as refused:
        vpn.checked(from_keywords(VpnRequest, {"device": [word]}, topology="sdc"))
    assert str(refused.value).startswith(f"--device {word}: ")


@pytest.mark.parametrize(
    ("service", "word"),
    [
        ("bb84", f"alice.{FIDELITY}"),
        ("distribute", f"bob.{MADE_WRONG}"),
        ("distribute", f"alice.{FIDELITY}"),  # charlie makes them
    ],
)
def test_heavy_traffic_refuses_what_no_session_of_it_feels(service: str, word: str) -> None:
    with pytest.raises(BadInput) as refused:
        check_load(word, service=service)
    assert str(refused.value).startswith(f"--device {word}: ")


@pytest.mark.parametrize(
    ("word", "options"),
    [
        (f"charlie.{FIDELITY}", {"service": "distribute"}),
        (f"alice.{FIDELITY}", {"service": "distribute", "source": "own"}),
        (f"bob.{WRONG}", {"service": "bb84"}),  # who opens other sessions
        (f"bob.{FIDELITY}", {"service": "sdc", "source": "own"}),
    ],
)
def test_heavy_traffic_takes_what_acts_in_some_session(word: str, options: dict[str, Any]) -> None:
    check_load(word, **options)


def test_of_traffic_one_way_whose_source_is_who_asks_the_asked_make_no_pairs() -> None:
    one_way = {"service": "distribute", "source": "own", "senders": "alice", "receivers": "bob"}
    check_load(f"alice.{FIDELITY}", **one_way)
    with pytest.raises(BadInput, match=f"--device bob.{re.escape(FIDELITY)}: "):
        check_load(f"bob.{FIDELITY}", **one_way)


def check_load(word: str, **options: Any) -> None:
    request = from_keywords(LoadRequest, {"device": [word], **options}, topology="ring")
    load.checked(request)


@pytest.mark.parametrize(
    ("service", "options", "refusal"),
    [
        ("bb84", {"fiber": ["charlie-q1.depolarizing=1"]}, "no light of bb84 goes through"),
        ("bb84", {"fiber": ["charlie-q1.length_km=1"]}, "no light of bb84 goes through charlie-q1"),
        ("bb84", {"node": ["charlie=ion-trap"]}, "charlie takes no part in bb84"),
        (
            "bb84",
            {"topology": "tree", "switch": ["q5.rotation=1"]},
            "no light of bb84 goes through q5",
        ),
        ("sense", {**SEPARATE, "fiber": ["alice-q1.pauli_x=1"]}, "goes through alice-q1"),
        ("sense", {**SEPARATE, "fiber": ["pauli_x=1"]}, "goes through any fibre"),
        ("sense", {**SEPARATE, "switch": ["rotation=1"]}, "goes through any quantum switch"),
        ("sense", {**SEPARATE, "depolarizing": 0.1}, "--depolarizing: no light of sense"),
        ("swap", {**BLIND_ALLEYS, "fiber": ["charlie-q1.pauli_x=1"]}, "goes through charlie-q1"),
        ("swap", {**BLIND_ALLEYS, "device": ["charlie.memory.t2_s=1"]}, "charlie takes no part"),
        ("swap", {**BLIND_ALLEYS, "switch": ["q3.rotation=1"]}, "goes through q3"),
    ],
)
def test_parts_without_light_of_a_job_are_refused(
    service: str, options: dict[str, Any], refusal: str
) -> None:
    with pytest.raises(BadInput, match=refusal):
        checked(service_request(service, **options))


@pytest.mark.parametrize(
    "options",
    [
        {"fiber": ["alice-q1.depolarizing=0.1", "q1-bob.length_km=1"]},
        {"fiber": ["depolarizing=0.1"], "switch": ["rotation=1", "q1.insertion_loss_db=1"]},
        {"node": ["bob=photonic"]},
        {"topology": "ring", "fiber": ["q3-q4.pauli_x=0.1"]},
        {"service": "sense", "fiber": ["charlie-q1.pauli_x=1"], "switch": ["rotation=1"]},
        {"service": "sense", **SEPARATE, "fiber": ["length_km=1", "alice-q1.length_km=2"]},
        {"service": "swap", **BLIND_ALLEYS, "fiber": ["alice-q1.pauli_x=1", "q1-q2.pauli_x=1"]},
    ],
)
def test_parts_with_light_of_a_job_are_taken(options: dict[str, Any]) -> None:
    checked(service_request(**{"service": "bb84", **options}))


@pytest.mark.parametrize(
    ("options", "refusal"),
    [
        ({"fiber": ["charlie-q2.pauli_x=1"]}, "no light of bb84 goes through charlie-q2"),
        ({"fiber": ["alice-q1.pauli_x=0.1", "q3-q4.pauli_x=0.1", "depolarizing=0.1"]}, None),
    ],
)
def test_traffic_of_two_hosts_has_no_light_at_a_third(
    options: dict[str, Any], refusal: str | None
) -> None:
    """In the ring of q1 to q4 light of alice (q1) and bob (q3) can go both ways round."""
    traffic = {"service": "bb84", "senders": "alice", "receivers": "bob", **options}
    request = from_keywords(LoadRequest, traffic, topology="ring")
    with pytest.raises(BadInput, match=refusal) if refusal else nullcontext():
        load.checked(request)


def test_settings_of_presets_that_a_job_does_not_feel_are_named() -> None:
    """Of the preset lab: pairs of fidelity .99, and detectors, at every host."""
    unused = checked(service_request("bb84", preset="lab"))[1].unused_settings
    assert "alice.source.fidelity" in unused
    assert "alice.detectors.efficiency" in unused
    assert "bob.detectors.efficiency" not in unused
    assert not any(each.startswith("charlie.") for each in unused)  # who takes no part


def test_what_a_map_gives_all_its_hosts_is_not_named() -> None:
    """Its delay lines, which BB84 does not use; of a preset's analysers the rest is named."""
    ends = {"sender": "rm1", "receiver": "mi1", "topology": "map", "map": "garr"}
    assert checked(service_request("bb84", **ends))[1].unused_settings == ()
    unused = checked(service_request("bb84", preset="lab", **ends))[1].unused_settings
    assert "rm1.source.fidelity" in unused
    assert not any("delay_line" in each for each in unused)


@pytest.mark.parametrize("service", ["sdc", "netqasm"])
def test_a_job_of_another_kind_checks_its_settings(service: str, tmp_path: Path) -> None:
    (tmp_path / "app_alice.py").write_text("def main(app_config): pass")
    words = [] if service == "sdc" else [str(tmp_path)]
    run = ["run", "sdc"] if service == "sdc" else ["netqasm"]
    unfelt = ["--device", "eve.gates.kind=paulis", "--topology", "tapped"]
    arguments = described(run).parse_args([*run, *words, *unfelt, "--runs", str(tmp_path)])
    assert arguments.call(arguments) == 1
