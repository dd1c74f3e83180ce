"""The option `--schedule`: a policy in which the controller finds it."""

from pathlib import Path

import pytest

from controller_apps.policy.reading import DEFAULT, read_policy
from controller_apps.policy.schedules import SCHEDULES, Purification
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


def test_switches_take_turns_and_purify() -> None:
    request, _network = checked(parse("swap", "--topology", "chain,2", "--schedule", "nested"))
    assert request.network.switch == ("analysers=1", "memories=2", "sources=1")
    assert (request.service, getattr(request.options, "swaps", 0)) == ("switch_swap", 2)
    request, _network = checked(parse("swap", "--topology", "chain", "--purify", "1"))
    assert (request.service, request.purify) == ("switch_swap", 1)


def test_hosts_that_purify_nothing_take_no_turns() -> None:
    with pytest.raises(BadInput, match="hosts take turns only where they purify: add --purify 1"):
        checked(parse("swap", "--schedule", "nested"))
    assert checked(parse("swap", "--schedule", "parallel"))


@pytest.mark.parametrize(("switches", "swaps"), [(1, 1), (3, 3), (4, 3)])
def test_between_memories_that_emit_every_second_switch_of_a_chain_is_a_station(
    switches: int, swaps: int
) -> None:
    words = ["--topology", f"chain,{switches}", "--node", "nv-centre"]
    changed = ["--switch", "q2.memory.capacity=9"] if switches > 1 else []
    request, network = checked(parse("swap", *words, *changed, "--sample", "0", "--count", "5"))
    assert (request.service, getattr(request.options, "swaps", 0)) == ("switch_swap", swaps)
    for name, optics in network.parts.switches.items():
        emits = int(name[1:]) % 2 == 0
        assert optics.emitters == (2 if emits else 0)
        assert optics.analyser.kind == ("gates" if emits else "linear")
        assert not emits or optics.memory.capacity == (9 if name == "q2" else 5)
        assert not emits or optics.emitter == NV_CENTRE.emitter


def test_between_memories_that_emit_hosts_swap_where_no_switch_has_an_analyser() -> None:
    words = ["--topology", "repeaters,stations", "--node", "nv-centre", "--sample", "0"]
    request, _network = checked(parse("swap", *words, "--count", "5"))
    assert (request.service, getattr(request.options, "swaps", 0)) == ("swap", 0)


@pytest.mark.parametrize(
    ("words", "service"),
    [
        ((), "swap"),
        (("--topology", "sdc"), "swap"),
        (("--topology", "sdc", "--swaps", "1"), "switch_swap"),
        (("--topology", "sdc", "--switch", "q1.analysers=1"), "switch_swap"),
        (("--topology", "chain,2", "--swaps", "1"), "switch_swap"),
    ],
)
def test_switches_swap_where_they_have_analysers_and_hosts_elsewhere(
    words: tuple[str, ...], service: str
) -> None:
    request, _network = checked(parse("swap", *words))
    assert request.service == service
