"""The option `--schedule`: a policy in which the controller finds it."""

from pathlib import Path

import pytest

from controller_apps.policy.reading import DEFAULT, read_policy
from controller_apps.policy.schedules import SCHEDULES, Purification
from hosts.middleware.services.swapping import SwapOptions
from qmn.__main__ import described
from qmn.jobs.counted_service import checked, with_policy
from qmn.options import BadInput
from qmn.requests.service import ServiceRequest
from qmn.verbs.run import service_request
from topologies.catalogue.node_kinds import NV_CENTRE


def parse(*words: str) -> ServiceRequest:
    """Return what the command line asks for."""
    whole = ["run", *words]
    return service_request(described(whole).parse_args(whole))


@pytest.mark.parametrize("name", SCHEDULES)
def test_the_controller_reads_it_beside_what_the_default_policy_says(
    tmp_path: Path, name: str
) -> None:
    request, network = checked(parse("swap", "--topology", "chain", "--schedule", name))
    policy = read_policy(Path(with_policy(request, network, tmp_path).options.policy))
    assert policy.schedule == name
    assert policy.reporting == read_policy(DEFAULT).reporting


def test_rounds_of_purification_are_in_the_policy(tmp_path: Path) -> None:
    request, network = checked(parse("swap", "--schedule", "nested", "--purify", "2"))
    policy = read_policy(Path(with_policy(request, network, tmp_path).options.policy))
    assert (policy.schedule, policy.purification) == ("nested", Purification("dejmps", 2))


def test_without_it_no_policy_is_made(tmp_path: Path) -> None:
    request, network = checked(parse("swap"))
    assert with_policy(request, network, tmp_path) is network
    assert network.options.policy == ""
    assert list(tmp_path.iterdir()) == []


def test_it_and_a_policy_of_the_users_own_are_refused() -> None:
    request = parse("swap", "--purify", "1", "--policy", str(DEFAULT))
    with pytest.raises(BadInput, match=r"write \[swap\] schedule and rounds into"):
        checked(request)


def test_only_swaps_have_turns() -> None:
    with pytest.raises(SystemExit):
        parse("distribute", "--schedule", "nested")


@pytest.mark.parametrize(
    ("words", "swaps"),
    [
        ((), 3),
        (("--topology", "sdc"), 1),
        (("--topology", "chain,2", "--schedule", "nested"), 2),
        (("--topology", "chain,2", "--swaps", "1"), 1),
        (("--topology", "chain,3", "--switch", "q2.analysers=1"), 1),
        (("--topology", "ring"), 3),  # alice at q1, bob at q3: q1, q2 or q4, q3
        (("--topology", "chain,80"), 64),
    ],
)
def test_every_switch_on_the_way_that_can_swaps_unless_it_is_said_in_how_many(
    words: tuple[str, ...], swaps: int
) -> None:
    request, _network = checked(parse("swap", *words))
    assert isinstance(request.options, SwapOptions)
    assert request.options.swaps == swaps
    named = any("analysers" in word for word in words)
    parts = ("q2.analysers=1",) if named else ("analysers=1", "memories=2", "sources=1")
    assert request.network.switch == parts


@pytest.mark.parametrize(("switches", "swaps"), [(1, 1), (3, 3), (4, 3)])
def test_between_memories_that_emit_every_second_switch_of_a_chain_is_a_station(
    switches: int, swaps: int
) -> None:
    words = ["--topology", f"chain,{switches}", "--node", "nv-centre"]
    changed = ["--switch", "q2.memory.capacity=9"] if switches > 1 else []
    request, network = checked(parse("swap", *words, *changed, "--sample", "0", "--count", "5"))
    assert getattr(request.options, "swaps", 0) == swaps
    for name, optics in network.parts.switches.items():
        emits = int(name[1:]) % 2 == 0
        assert optics.emitters == (2 if emits else 0)
        assert optics.analyser.kind == ("gates" if emits else "linear")
        assert not emits or optics.memory.capacity == (9 if name == "q2" else 5)
        assert not emits or optics.emitter == NV_CENTRE.emitter


@pytest.mark.parametrize(
    "words",
    [("--topology", "repeaters"), ("--topology", "chain", "--switch", "q1.analysers=0")],
)
def test_without_a_switch_between_both_that_can_the_refusal_names_a_topology(
    words: tuple[str, ...],
) -> None:
    with pytest.raises(BadInput, match=r"analyser between them: choose --topology chain,3, or"):
        checked(parse("swap", *words))
