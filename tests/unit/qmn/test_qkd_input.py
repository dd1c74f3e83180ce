"""The input of `qmn run qkd`, and what it refuses before anything starts."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from applications.key_distribution.options import KeyOptions
from qmn.__main__ import described
from qmn.jobs.counted_service import checked
from qmn.network.description import describe_network
from qmn.options import BadInput
from qmn.requests.service import ServiceRequest
from qmn.verbs.run import service_request
from topologies.quantum_topo import QuantumTopo


def parse(*words: str) -> ServiceRequest:
    """Return what the command line asks for."""
    whole = ["run", *words]
    return service_request(described(whole).parse_args(whole))


@pytest.mark.parametrize(
    ("words", "service"),
    [((), "bb84"), (("--protocol", "bb84"), "bb84"), (("--protocol", "bbm92"), "bbm92")],
)
def test_a_protocol_of_key_distribution_is_a_service(words: tuple[str, ...], service: str) -> None:
    request, _network = checked(parse("qkd", *words))
    assert request.service == service
    assert request.options == KeyOptions(host="bob", port=9)


def test_options_reach_the_service() -> None:
    words = "--count 5000 --correction ldpc --max-qber 0.05 --test-fraction 0.2 --epsilon 1e-9"
    request, _network = checked(parse("qkd", *words.split(), "--bound", "asymptotic"))
    assert request.options == KeyOptions(
        host="bob",
        port=9,
        count=5000,
        correction="ldpc",
        max_qber=0.05,
        test_fraction=0.2,
        epsilon=1e-9,
        bound="asymptotic",
    )


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["qkd", "--max-qber", "0.3"], "at 0.11 no key is secret"),
        (["qkd", "--count", "2000000000000"], "count 2000000000000: choose 1 to 1000000000000"),
        (["qkd", "--seconds", "-1"], "seconds -1.0: choose up to 31622400"),
        (["qkd", "--hand-out", "/tmp"], "--hand-out /tmp exists: name a new folder"),
        (["qkd", "--to", "alice"], "sender and receiver are both alice"),
        (["teleport", "--count", "0"], "count 0"),
    ],
)
def test_what_cannot_be_is_refused(words: list[str], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        checked(parse(*words))


def test_keys_go_into_a_new_folder_only(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="name a new folder"):
        checked(parse("qkd", "--keys", str(tmp_path)))
    checked(parse("qkd", "--keys", str(tmp_path / "new")))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("verb", ["teleport", "distribute"])
def test_what_makes_no_keys_is_not_told_where_to_keep_them(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert parse(verb).network.keys == ""
    with pytest.raises(SystemExit):
        parse(verb, "--keys", "keys")
    assert "there is no --keys" in capsys.readouterr().err


def test_a_session_has_a_count_or_a_time(capsys: pytest.CaptureFixture[str]) -> None:
    request, _network = checked(parse("qkd", "--seconds", "2.5"))
    assert request.options == KeyOptions(host="bob", port=9, seconds=2.5)
    with pytest.raises(SystemExit):
        parse("qkd", "--seconds", "2.5", "--count", "5000")
    assert "not allowed with argument" in capsys.readouterr().err


@pytest.mark.parametrize("words", [(), ("--device", "charlie.detectors.efficiency=0.5")])
def test_a_relay_has_a_beam_splitter_as_if_by_its_option(words: tuple[str, ...]) -> None:
    asked = parse("qkd", "--protocol", "mdi", *words)
    request, network = checked(asked)
    option = "charlie.analyser.kind=beam-splitter"
    stated = replace(asked.network, device=(*asked.network.device, option))
    expected = describe_network(stated)
    assert network.parts == expected.parts
    assert network.stated_devices == expected.stated_devices
    assert network.topo.nodeInfo("charlie") == expected.topo.nodeInfo("charlie")
    assert request.network == network.options == expected.options == stated


def test_a_named_analyser_of_a_relay_stays() -> None:
    option = "charlie.analyser.kind=linear"
    request, network = checked(parse("qkd", "--protocol", "mdi", "--device", option))
    assert network.parts.hosts["charlie"].analyser.kind == "linear"
    assert request.network.device == (option,)


@pytest.mark.parametrize("words", [("--protocol", "mdi"), ("--eve", "0.5"), ("--preset", "lab")])
def test_a_request_builds_its_topology_once(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    built, add_nodes = [], QuantumTopo._add_nodes

    def count(topo: QuantumTopo) -> None:
        built.append(topo)
        add_nodes(topo)

    monkeypatch.setattr(QuantumTopo, "_add_nodes", count)
    _request, network = checked(parse("qkd", *words))
    assert built == [network.topo]


def test_ldpc_without_its_package_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ldpc", None)  # as where it is not installed
    checked(parse("qkd"))
    for words in (["qkd", "--correction", "ldpc"], ["conference"]):
        with pytest.raises(BadInput, match=r"pip install 'qmn\[ldpc\]'"):
            checked(parse(*words))


OF_LASER = ("source.statistics=poisson", "source.mean_pairs=0.5")
LASER = [
    *("qkd", "--rate-hz", "1000000000", "--fiber", "alice-q1.connectors_db=27"),
    *(word for setting in OF_LASER for word in ("--device", f"alice.{setting}")),
    *("--device", "bob.detectors.efficiency=0.5"),
]
BY_DEFAULT = 131_072


@pytest.mark.parametrize(
    ("words", "pulses"),
    [
        ((), 100_237_446),  # of 0.5 photons; 50,000 come through 27 dB and click with 0.5
        (("--fiber", "alice-q1.connectors_db=7"), 1_002_374),
        (("--switch", "q1.insertion_loss_db=10"), 1_000_000_000),  # a second
        (("--switch", "q1.crosstalk_db=50"), BY_DEFAULT),
        (("--fiber", "q1-bob.pdl_db=0.1"), BY_DEFAULT),
        (("--fiber", "phase_drift_rad_per_sqrt_km=0.1"), 100_237_446),  # of time bins alone
        (("--eve", "0.1"), BY_DEFAULT),
        (("--block-pairs", "5000"), 5000),
        (("--rate-hz", "50000000"), 50_000_000),
        (("--device", "alice.source.heralding_efficiency=0.5"), BY_DEFAULT),
    ],
)
def test_a_block_of_a_laser_is_as_long_as_little_of_it_may_click(
    words: tuple[str, ...], pulses: int
) -> None:
    request, _network = checked(parse(*LASER, *words))
    assert request.options.block_pairs == pulses


OF_PAIRS = [
    *("qkd", "--protocol", "bbm92", "--rate-hz", "1000000000"),
    *("--device", "charlie.source.statistics=poisson"),
    *("--device", "charlie.source.mean_pairs=0.05"),
    *("--fiber", "alice-q1.connectors_db=10", "--fiber", "q1-bob.connectors_db=20"),
]


@pytest.mark.parametrize(
    ("words", "pulses"),
    [
        ((), 9_999_999),  # of 0.05 pairs; 50,000 of them come through 10 dB to alice
        (("--device", "alice.detectors.efficiency=0.05"), 100_000_000),  # as many to bob
        (("--device", "alice.detectors.efficiency=0.2"), 49_999_999),
        (("--fiber", "charlie-q1.connectors_db=30"), 1_000_000_000),  # a second
        (("--fiber", "q1-bob.pdl_db=0.1"), BY_DEFAULT),
        (("--eve", "0.1"), BY_DEFAULT),
        (("--block-pairs", "4000000000"), 4_000_000_000),
        (("--device", "charlie.source.statistics=thermal"), BY_DEFAULT),
        (("--protocol", "e91"), BY_DEFAULT),
    ],
)
def test_a_block_of_pairs_is_as_long_as_little_of_it_may_click(
    words: tuple[str, ...], pulses: int
) -> None:
    request, _network = checked(parse(*OF_PAIRS, *words))
    assert request.options.block_pairs == pulses
