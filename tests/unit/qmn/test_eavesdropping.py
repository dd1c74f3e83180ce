"""The option `--eve`: a topology that has her, and a policy that puts her on the fibre."""

from pathlib import Path

import pytest

from controller_apps.policy.policy import Tap
from controller_apps.policy.reading import DEFAULT, read_policy
from qmn.__main__ import described
from qmn.jobs.counted_service import attack_of, checked, with_policy
from qmn.jobs.eavesdropping import Attack
from qmn.options import BadInput
from qmn.requests.service import ServiceRequest
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
        (["--eve", "0.5", "--eve-attack", "split"], "on every pulse: say --eve 1"),
        (
            ["--protocol", "bbm92", "--eve", "1", "--eve-attack", "split"],
            "in bbm92 no sender prepares pulses; choose --protocol bb84",
        ),
        (["--eve", "1", "--eve-hides-db", "3"], "say both, or neither"),
        (["--eve", "1", "--eve-attack", "split", "--eve-hides-db", "-1"], "choose 0 to 100"),
    ],
)
def test_what_cannot_be_is_refused(words: list[str], text: str) -> None:
    with pytest.raises(BadInput, match=text):
        checked(parse("qkd", *words))


def test_who_splits_knows_what_is_lost_behind_her() -> None:
    """Two fibres of 2 km at .2 dB/km, q1's 1.5 dB, and detectors of one tenth: 12.3 dB."""
    words = ["--length-km", "2", "--loss-db-per-km", "0.2", "--switch", "q1.insertion_loss_db=1.5"]
    device = ["--device", "bob.detectors.efficiency=0.1"]
    split = ["--eve", "1", "--eve-attack", "split", "--eve-hides-db", "7"]
    attack = attack_of(*checked(parse("qkd", *split, *words, *device)))
    assert attack is not None
    assert attack.onward_db == pytest.approx(12.3)
    assert attack.expected_db == pytest.approx(19.3)
    assert attack_of(*checked(parse("qkd", "--eve", "0.3"))) == Attack(0.3)
    assert attack_of(*checked(parse("qkd"))) is None


def test_only_key_distribution_has_her() -> None:
    with pytest.raises(SystemExit):
        parse("teleport", "--eve", "1")
