"""What `--eve` asks for: a topology that has her, and a policy that puts her on the fibre."""

import argparse
from pathlib import Path

import pytest

from controller_apps.policy.policy import DEFAULT, Tap, read_policy
from qmn.jobs import eavesdropping
from qmn.jobs.service import add_parsers, check_input
from qmn.network.options import BadInput
from qmn.network.topologies import topology


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_parsers(parser.add_subparsers())
    return parser.parse_args(words)


def tap_of(folder: Path, *words: str) -> Tap:
    """Return the tap that a run makes, beside what the default policy says."""
    arguments = parse("qkd", "--eve", "0.1", *words)
    check_input(arguments)
    eavesdropping.make_policy(arguments, topology(arguments)(), folder)
    policy = read_policy(arguments.policy)
    assert policy.reporting == read_policy(DEFAULT).reporting
    (tap,) = policy.taps
    return tap


def test_she_is_between_the_light_and_who_measures_it(tmp_path: Path) -> None:
    assert tap_of(tmp_path) == Tap(("alice", "bob"), "eve")
    assert tap_of(tmp_path, "--from", "bob", "--to", "charlie") == Tap(("bob", "charlie"), "eve")
    assert tap_of(tmp_path, "--protocol", "bbm92") == Tap(("charlie", "bob"), "eve")


def test_the_network_that_has_her_is_taken() -> None:
    arguments = parse("qkd", "--eve", "0.5")
    check_input(arguments)
    assert arguments.topology == "tapped"
    arguments = parse("qkd")
    check_input(arguments)
    assert (arguments.topology, arguments.eve) == ("sdc", None)


def test_without_her_no_policy_is_made(tmp_path: Path) -> None:
    arguments = parse("qkd")
    eavesdropping.make_policy(arguments, topology(arguments)(), tmp_path)
    assert arguments.policy is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--eve", "1.5"], "--eve 1.5: choose 0 to 1"),
        (["--eve", "nan"], "--eve nan: choose 0 to 1"),
        (["--eve", "1", "--topology", "ring"], "ring has no host eve; use --topology tapped"),
        (["--eve", "1", "--to", "eve"], "eve is sender or receiver"),
        (["--eve", "1", "--policy", str(DEFAULT)], "leave out --policy"),
    ],
)
def test_what_cannot_be_is_refused(words: list[str], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        check_input(parse("qkd", *words))


def test_only_key_distribution_has_her() -> None:
    with pytest.raises(SystemExit):
        parse("teleport", "--eve", "1")
