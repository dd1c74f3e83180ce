"""Settings of devices that a job would not feel are refused by name, with the one that acts."""

from typing import Any

import pytest

from applications.vpn import job as vpn
from applications.vpn.request import VpnRequest
from evidence.traffic import job as load
from evidence.traffic.request import LoadRequest
from qmn.jobs.counted_service import checked
from qmn.network.description import describe_network
from qmn.options import BadInput, from_keywords
from qmn.requests.service import service_request

FIDELITY, WRONG = "source.fidelity=0.9", "source.preparation_error=0.1"
MADE_WRONG = "gates.initialization_error=0.1"
DIAGONAL = "source.bell_diagonal=[0.7, 0.1, 0.1, 0.1]"


def check(service: str, *words: str, **options: Any) -> None:
    """Check a request with these words of --device."""
    checked(service_request(service, device=list(words), **options))


@pytest.mark.parametrize(
    ("service", "word", "options", "refusal"),
    [
        ("bb84", f"alice.{FIDELITY}", {}, "err by alice.source.preparation_error: give that"),
        ("bb84", f"alice.{DIAGONAL}", {}, "alice makes no pairs in bb84"),
        ("bb84", f"bob.{FIDELITY}", {}, "bob makes no pairs in bb84"),
        ("mdi", f"bob.{FIDELITY}", {}, "err by bob.source.preparation_error"),
        ("teleport", f"alice.{FIDELITY}", {}, "err by alice.source.preparation_error"),
        ("bbm92", f"alice.{FIDELITY}", {}, "alice makes no pairs in bbm92: give it for charlie"),
        ("bbm92", f"charlie.{WRONG}", {}, "its pairs err by charlie.source.fidelity: give that"),
        ("distribute", f"charlie.{WRONG}", {}, "charlie prepares no states in distribute"),
        ("distribute", f"alice.{MADE_WRONG}", {}, "no qubit is made in |0> in distribute"),
        ("sense", f"alice.{MADE_WRONG}", {}, "no qubit is made in |0> in sense"),
        ("sense", f"alice.{FIDELITY}", {"probes": "separate"}, "preparation_error: give that"),
        ("sense", f"alice.{WRONG}", {}, "its pairs err by alice.source.fidelity"),
        ("ghz", f"charlie.{FIDELITY}", {}, "charlie makes no pairs in ghz"),
        ("swap", f"bob.{FIDELITY}", {}, "bob makes no pairs in swap"),
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
        ("bb84", f"charlie.{FIDELITY}", {}),  # who takes no part
    ],
)
def test_a_setting_that_acts_is_taken(service: str, word: str, options: dict[str, Any]) -> None:
    check(service, word, **options)


@pytest.mark.parametrize("word", [f"alice.{FIDELITY}", f"bob.{DIAGONAL}", f"bob.{MADE_WRONG}"])
def test_keys_of_a_vpn_refuse_what_bb84_does_not_feel(word: str) -> None:
    with pytest.raises(BadInput) as refused:
        vpn.checked(from_keywords(VpnRequest, {"device": [word]}, usual_topology="sdc"))
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


def check_load(word: str, **options: Any) -> None:
    request = from_keywords(LoadRequest, {"device": [word], **options}, topology="ring")
    load.checked(request, describe_network(request.network))
