"""A host that is refused light hears which element is in the way, if the policy allows that."""

import re
from dataclasses import replace

import pytest
from metadata_scene import ALICE, BOB, FRAMED, S1, frame, payload_of, rotating

from controller_apps.light.optics import SwitchOptics, SwitchPort
from controller_apps.light.paths import HostPort, Network
from controller_apps.policy.policy import Policy
from controller_apps.policy.reading import parse_policy
from controller_apps.sessions.actions import Forward, Note
from controller_apps.sessions.arbiter import Arbiter
from controller_apps.sessions.terms import UNFILTERED
from wire.metadata.decoding import decode
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict
from wire.optical import PathOptics

NEAR, FAR = SwitchPort(1, 2), SwitchPort(2, 2)
KEYS = replace(FRAMED, service=Service["BB84"], source=ALICE)


def two_switches() -> Network:
    """Return alice - q1 - q2 - bob."""
    found = Network({1, 2}, names={1: "q1", 2: "q2"})
    found.attach(SwitchPort(1, 1), HostPort("alice", ALICE, "alice-q0"))
    found.attach(SwitchPort(2, 1), HostPort("bob", BOB, "bob-q0"))
    found.add_link(NEAR, FAR)
    found.optics.switches = {dpid: rotating(0) for dpid in (1, 2)}
    return found


def refusal(found: Network, setup: Setup = KEYS, names_elements: bool = True) -> tuple[Setup, str]:
    """Return the messages of a set-up to the hosts and the operator."""
    state = Arbiter(found, 5.0, 30.0)
    state.follow(replace(UNFILTERED, names_elements=names_elements))
    segment = frame(setup.encode(), sport=40_000, source=ALICE, destination=BOB)
    actions = state.segment_arrived(S1, 1, segment, 0.0)
    (sent,) = (action for action in actions if isinstance(action, Forward))
    (note,) = (action for action in actions if isinstance(action, Note))
    answer = decode(payload_of(sent.frame))
    assert isinstance(answer, Setup)
    assert answer.verdict == Verdict.REFUSED
    return answer, note.detail


def test_a_cut_in_the_middle_of_the_network() -> None:
    found = two_switches()
    found.set_fiber(NEAR, whole=False)
    answer, detail = refusal(found)
    assert (answer.reason, answer.obstacle) == (Reason.PATH_BROKEN, "fibre q1-q2 is cut")
    assert detail == "PATH_BROKEN: fibre q1-q2 is cut"


def test_a_stuck_cross_connect_in_the_middle_of_the_network() -> None:
    found = two_switches()
    found.optics.switches[1] = SwitchOptics.reported([PathOptics(1, 7, 0, 0, stuck=True)])
    answer, _detail = refusal(found)
    assert answer.obstacle == "cross-connect 1 -> 7 of q1 is stuck"


def test_a_policy_may_keep_it_to_who_runs_the_network() -> None:
    found = two_switches()
    found.set_fiber(NEAR, whole=False)
    answer, detail = refusal(found, names_elements=False)
    assert (answer.reason, answer.obstacle) == (Reason.PATH_BROKEN, "")
    assert detail == "PATH_BROKEN: fibre q1-q2 is cut"


def test_a_host_cannot_put_words_into_the_mouth_of_the_controller() -> None:
    asked = replace(KEYS, obstacle="fibre q9-q10 is cut")
    found = two_switches()
    found.remove_link(NEAR)
    answer, _detail = refusal(found, asked)
    assert (answer.reason, answer.obstacle) == (Reason.NO_PATH, "")


def test_a_host_with_too_few_fibres_is_named() -> None:
    """Superdense coding takes two at its receiver; from a source of his own, bob has but one."""
    answer, detail = refusal(two_switches(), replace(KEYS, service=Service.SDC, source=ALICE))
    found = re.fullmatch(r"(alice|bob) has 1 fibre, SDC needs 2 there", answer.obstacle)
    assert found
    assert (answer.reason, detail) == (Reason.NO_PATH, f"NO_PATH: {answer.obstacle}")


def test_a_chain_of_switches_whose_fibre_is_cut_is_refused_by_the_name_of_the_fibre() -> None:
    found = two_switches()
    found.set_fiber(SwitchPort(1, 1), whole=False)
    answer, _detail = refusal(found, replace(KEYS, service=Service.SWAP, block=2))
    assert answer.reason == Reason.FIBER_CUT
    assert answer.obstacle == "fibre alice-q1 (alice-q0) is cut"


def test_the_policy_says_so_by_a_word() -> None:
    assert Policy().names_elements
    assert not parse_policy("[refusal]\nnames_elements = false\n").names_elements


@pytest.mark.parametrize("text", ["names_elements = 1", 'names_elements = "no"', "names = true"])
def test_another_word_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="refusal"):
        parse_policy(f"[refusal]\n{text}\n")
