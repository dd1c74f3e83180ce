"""What the user asks of a service is checked before anything starts."""

import argparse

import pytest

from hosts.middleware.services.distribute import DistributeOptions
from qmn import run, service_run
from qmn.network_options import BadInput
from qmn.networks import BadTopology, quantum_hosts, topology


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    run.add_parser(parser.add_subparsers())
    return parser.parse_args(["run", *words])


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--count", "0"], "count is 0: choose 1 to"),
        (["--fidelity", "2"], "fidelity is 2.0: choose 0 to 1"),
        (["--fidelity", "0.9", "--sample", "0"], "cannot be known with sample 0"),
        (["--rounds", "2", "--purification", "none"], "choose bbpssw or dejmps"),
        (["--to", "alice"], "sender and receiver are both alice"),
    ],
)
def test_what_distribution_cannot_give_is_refused(words: list[str], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        service_run.check_input(parse("distribute", *words))


def test_the_words_of_the_command_line_reach_the_service() -> None:
    words = ("--count", "7", "--fidelity", "0.9", "--sample", "0.5", "--rounds", "2")
    options = service_run.check_input(parse("distribute", *words, "--purification", "bbpssw"))
    assert options == DistributeOptions(
        "bob", 9, 7, fidelity=0.9, sample=0.5, purification="bbpssw", rounds=2
    )
    assert options.fidelity_ppm == 900_000


def test_a_swap_goes_over_as_many_repeaters_as_are_wanted() -> None:
    arguments = parse("swap", "--repeaters", "3", "--count", "7")
    assert service_run.check_input(arguments) == DistributeOptions("bob", 9, 7)
    assert quantum_hosts(topology(arguments)()) == ["alice", "bob", "r1", "r2", "r3"]


def test_more_repeaters_than_a_chain_may_have_are_refused() -> None:
    with pytest.raises(BadTopology, match="17 repeaters: choose 1 to 16"):
        service_run.check_input(parse("swap", "--repeaters", "17"))


def test_the_defaults_of_the_command_line_are_those_of_the_service() -> None:
    assert service_run.check_input(parse("distribute")) == DistributeOptions("bob", 9)
