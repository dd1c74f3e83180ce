"""What `--eve` asks for: a topology that has her, and a policy that puts her on the fibre."""

from pathlib import Path

import pytest

from controller_apps.policy.policy import DEFAULT, Tap, read_policy
from qmn.__main__ import described
from qmn.jobs.service import ServiceRequest, checked, with_policy
from qmn.options import BadInput
from qmn.verbs.run import service_request


def parse(*words: str) -> ServiceRequest:
    """Return what the command line asks for."""
    whole = ["run", *words]
    return service_request(described(whole).parse_args(whole))


def tap_of(folder: Path, *words: str) -> Tap:
    """Return the tap that a run makes, beside what the default policy says."""
    request, network = checked(parse("qkd", "--eve", "0.1", *words))
    policy = read_policy(Path(with_policy(request, network, folder).options.policy))
    assert policy.reporting == read_policy(DEFAULT).reporting
    (tap,) = policy.taps
    return tap


def test_she_is_between_the_light_and_who_measures_it(tmp_path: Path) -> None:
    assert tap_of(tmp_path) == Tap(("alice", "bob"), "eve")
    assert tap_of(tmp_path, "--from", "bob", "--to", "charlie") == Tap(("bob", "charlie"), "eve")
    assert tap_of(tmp_path, "--protocol", "bbm92") == Tap(("charlie", "bob"), "eve")


def test_the_network_that_has_her_is_taken() -> None:
    _request, network = checked(parse("qkd", "--eve", "0.5"))
    assert network.options.topology == "tapped"
    assert "eve" in network.hosts
    request, network = checked(parse("qkd"))
    assert (network.options.topology, request.eve) == ("sdc", None)


def test_without_her_no_policy_is_made(tmp_path: Path) -> None:
    request, network = checked(parse("qkd"))
    assert with_policy(request, network, tmp_path) is network
    assert network.options.policy == ""
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
        checked(parse("qkd", *words))


def test_only_key_distribution_has_her() -> None:
    with pytest.raises(SystemExit):
        parse("teleport", "--eve", "1")
