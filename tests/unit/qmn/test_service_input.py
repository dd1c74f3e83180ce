"""The options of a service are checked before anything starts."""

import json
from itertools import pairwise
from pathlib import Path

import pytest

from applications.teleportation.teleport import TeleportOptions
from hosts.middleware.services.distribution.purification import DistributeOptions
from hosts.middleware.services.swapping import SwapOptions
from hosts.middleware.session.options import ServiceOptions
from qmn.__main__ import described
from qmn.jobs.counted_service import checked
from qmn.network.custom_topology import BadTopology
from qmn.options import BadInput
from qmn.requests.service import ServiceRequest
from qmn.verbs.run import service_request


def parse(*words: str) -> ServiceRequest:
    """Return what the command line asks for."""
    whole = ["run", *words]
    return service_request(described(whole).parse_args(whole))


def options_of(*words: str) -> ServiceOptions:
    """Return the options of the service."""
    request, _network = checked(parse(*words))
    return request.options


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--count", "0"], "count 0: choose 1 to"),
        (["--fidelity", "2"], "fidelity 2.0: choose 0 to 1"),
        (["--fidelity", "0.9", "--sample", "0"], "cannot be known with sample 0"),
        (["--rounds", "2", "--purification", "none"], "choose bbpssw or dejmps"),
        (["--to", "alice"], "sender and receiver are both alice"),
    ],
)
def test_what_distribution_cannot_give_is_refused(words: list[str], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        options_of("distribute", *words)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["ghz", "--line", "alice,bob,zoe"], "--line zoe: choose one of alice, bob, charlie"),
        (["graph", "--graph", "alice-zoe"], "'alice-zoe' is not an edge"),
    ],
)
def test_a_host_that_there_is_not_is_named(words: list[str], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        options_of(*words)


def test_the_words_of_the_command_line_reach_the_service() -> None:
    words = ("--count", "7", "--fidelity", "0.9", "--sample", "0.5", "--rounds", "2")
    options = options_of("distribute", *words, "--purification", "bbpssw")
    assert options == DistributeOptions(
        "bob", 9, count=7, fidelity=0.9, sample=0.5, purification="bbpssw", rounds=2
    )
    assert options.fidelity_ppm == 900_000


def test_a_swap_goes_over_all_switches_of_a_chain() -> None:
    request, network = checked(parse("swap", "--topology", "chain,5", "--count", "7"))
    assert request.options == SwapOptions("bob", 9, count=7, swaps=5)
    assert network.hosts == ["alice", "bob", "charlie"]


def test_distribution_of_memories_that_emit_has_stations_alone() -> None:
    words = "--topology", "chain,3", "--node", "nv-centre", "--count", "7"
    _request, network = checked(parse("distribute", *words))
    assert {each.memories for each in network.parts.switches.values()} == {0}
    assert {each.analyser.kind for each in network.parts.switches.values()} == {"linear"}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("chain,3 --swaps 9", "--swaps 9: 3 switches can swap; choose at most 3"),
        ("chain,5 --node nv-centre --swaps 4", "--swaps 4: .* station: choose an odd number"),
    ],
)
def test_swaps_that_a_chain_cannot_do_are_refused(words: str, text: str) -> None:
    with pytest.raises(BadInput, match=text):
        checked(parse("swap", "--topology", *words.split()))


def test_more_hosts_than_a_line_may_have_are_refused() -> None:
    with pytest.raises(BadTopology, match="65 repeaters: choose 1 to 64"):
        options_of("ghz", "--topology", "repeaters,65", "--line", "alice,r1,bob")


def test_the_defaults_of_the_command_line_are_those_of_the_service() -> None:
    assert options_of("distribute") == DistributeOptions("bob", 9)


@pytest.mark.parametrize("state", ["haar", "pi/3,0", "0,0"])
def test_states_that_are_no_stabiliser_states_need_state_vectors(state: str) -> None:
    for backend in ("chp", "stim"):
        words = ["--state", state, "--backend", backend]
        text = f"--state {state} is not a stabiliser state.*{backend}.*: add --backend dense"
        with pytest.raises(BadInput, match=text):
            options_of("teleport", *words)
    options = options_of("teleport", "--state", state, "--backend", "dense")
    assert options == TeleportOptions("bob", 9, state=state)


@pytest.mark.parametrize("state", ["random", "0", "-i"])
def test_cardinal_states_are_teleported_on_every_backend(state: str) -> None:
    for backend in ("chp", "stim", "dense"):
        options = options_of("teleport", f"--state={state}", "--backend", backend)
        assert options == TeleportOptions("bob", 9, state=state)


def test_an_unknown_state_is_refused_before_anything_starts() -> None:
    with pytest.raises(BadInput, match="state 'up': choose one of random, 0, 1"):
        options_of("teleport", "--state", "up", "--backend", "dense")


@pytest.mark.parametrize("rate", ["0", "-1", "nan", "20000"])
def test_a_classical_channel_of_no_rate_is_refused(rate: str) -> None:
    for job in ("teleport", "distribute"):
        with pytest.raises(BadInput, match=r"--classical-mbps .*: choose 0.001 to 10000"):
            options_of(job, f"--classical-mbps={rate}")


def test_light_is_no_faster_than_the_slowest_source_and_no_block_lasts_too_long() -> None:
    options = options_of("distribute", "--device", "bob.source.max_rate_hz=250")
    assert (options.rate_hz, options.block_pairs) == (250, 1250)
    options = options_of("distribute", "--node", "ion-trap", "--rate-hz", "100")
    assert (options.rate_hz, options.block_pairs) == (100, 500)
    words = ("--node", "bob=ion-trap", "--device", "bob.source.max_rate_hz=7")  # it has no source
    assert options_of("distribute", *words) == DistributeOptions("bob", 9)


def test_the_host_that_makes_pairs_can_be_chosen() -> None:
    options = options_of("teleport", "--source", "alice")
    assert options.source == "alice"
    with pytest.raises(BadInput, match="--source zoe: choose one of alice, bob, charlie"):
        options_of("distribute", "--source", "zoe")


def test_hosts_can_be_named_as_the_places_of_a_map_in_any_script(tmp_path: Path) -> None:
    names = ("東京", "大阪", "Zürich")
    ways = [
        {"node1": one, "node2": other, "distance": 1000, "attenuation": 0.0002}
        for one, other in pairwise(names)
    ]
    file = tmp_path / "own.json"
    file.write_text(json.dumps({"nodes": [{"name": n} for n in names], "qconnections": ways}))
    request, network = checked(
        parse("teleport", "--topology", f"map,{file}", "--from", "大阪", "--to", "zürich")
    )
    assert (request.sender, request.receiver) == ("h2", "zurich")
    assert network.node("東京") == "h"
    with pytest.raises(BadInput, match="unknown host '京都'"):
        checked(parse("teleport", "--topology", f"map,{file}", "--from", "京都", "--to", "東京"))
