"""The refusals of a receiver before it begins: it never ignores what a set-up asks for."""

from dataclasses import replace
from typing import Any

import pytest

from hosts.middleware.services.superdense.receiver import check_offer
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.offers import check_light
from hosts.middleware.session.options import MAX_BLOCK_PAIRS, MAX_FRAME_BYTES
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Fec, Handshake, MemoryState, Reason, Service

PLAIN = Setup(1, Service.SDC, Handshake.FRAMED, "10.0.0.3", MAX_BLOCK_PAIRS, MAX_FRAME_BYTES, 1)


def test_a_plain_set_up_is_served() -> None:
    check_offer(PLAIN, 4)


@pytest.mark.parametrize(
    ("field", "words"),
    [
        ("fec", r"error-correction code 7 is not known; offered are 0 \(none\), .*3 \(golay\)"),
        ("memory", "memory 7"),
        ("polarization", "polarisation basis 7"),
        ("phase_mrad", "phase 7"),
        ("fidelity_ppm", "fidelity at least 7"),
    ],
)
def test_what_is_not_offered_is_refused_by_name(field: str, words: str) -> None:
    change: dict[str, Any] = {field: 7}
    with pytest.raises(SessionError, match=words) as caught:
        check_offer(replace(PLAIN, **change), 4)
    assert caught.value.reason == Reason.UNSUPPORTED


def test_a_service_without_stations_refuses_memories_that_emit() -> None:
    setup = replace(PLAIN, service=Service["BB84"], memory=MemoryState.HERALDED)
    with pytest.raises(SessionError, match="memory 1 for bb84: choose 0"):
        check_light(setup)


@pytest.mark.parametrize("wavelength_pm", [0, 99_999, 10_000_001])
def test_what_is_no_wavelength_of_light_is_refused(wavelength_pm: int) -> None:
    with pytest.raises(SessionError, match=f"wavelength {wavelength_pm} pm") as caught:
        check_offer(replace(PLAIN, wavelength_pm=wavelength_pm), 4)
    assert caught.value.reason == Reason.UNSUPPORTED


@pytest.mark.parametrize("field", ["pairs", "frame_bytes"])
def test_what_is_too_large_is_refused_with_the_limit(field: str) -> None:
    change: dict[str, Any] = {field: getattr(PLAIN, field) + 1}
    with pytest.raises(SessionError, match=f"at most {MAX_FRAME_BYTES} and {MAX_BLOCK_PAIRS}"):
        check_offer(replace(PLAIN, **change), 4)


def test_frames_that_a_code_or_an_alphabet_makes_too_long_are_refused() -> None:
    assert check_offer(PLAIN, 4).pairs(MAX_FRAME_BYTES) == MAX_BLOCK_PAIRS
    for setup, symbols in ((PLAIN, 3), (replace(PLAIN, fec=Fec.HAMMING), 4)):
        with pytest.raises(SessionError, match="choose fewer bytes") as caught:
            check_offer(setup, symbols)
        assert caught.value.reason == Reason.UNSUPPORTED


def test_an_analyser_that_tells_two_bell_states_carries_nothing() -> None:
    with pytest.raises(
        SessionError, match=r"distinguishes 2 Bell states: choose another analyser\.kind"
    ):
        check_offer(PLAIN, 2)
