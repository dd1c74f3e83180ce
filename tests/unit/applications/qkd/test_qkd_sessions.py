"""Whole sessions of key distribution, in silence and under attack."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from qkd_ends import SESSION, SHORT, Ends, bb84, make_ends

from applications.qkd.end import End, State
from applications.qkd.key_length import finite_key_length
from applications.qkd.messages import AbortReason, Confirm, Reconciliation, unframe
from applications.qkd.parameters import Parameters
from applications.qkd.sifting import Record
from wire.outcomes import NO_CLICK

PHOTONS = 2000
NOISE = 0.03


def failures(ends: Ends) -> list[AbortReason]:
    """Return the reason of each end; both must have failed and hold no key."""
    reasons = []
    for end in (ends.alice, ends.bob):
        assert end.state is State.ABORTED
        assert end.key is None
        assert end.failure is not None
        reasons.append(end.failure.reason)
    return reasons


def raw_key(end: End) -> bytes:
    return end._raw.tobytes()


def same_key(ends: Ends) -> bool:
    """Whether both ends hold a key, and the same one."""
    alices, bobs = ends.alice.key, ends.bob.key
    return alices is not None and bobs is not None and np.array_equal(alices, bobs)


@pytest.mark.by_day(every=10)
@pytest.mark.parametrize("part", range(10))
def test_both_ends_hold_the_same_keys_in_a_thousand_sessions(part: int) -> None:
    """A hundred in each part, so that processes can share them."""
    rng = np.random.default_rng((20121103, part))
    keys = 0
    for _ in range(100):
        ends = make_ends(rng)
        ends.run(bb84(rng, PHOTONS, rng.uniform(0, 0.06)))
        if ends.alice.failure:  # the sample may look too bad, corrected keys may differ
            assert set(failures(ends)) <= {
                AbortReason.NOISY,
                AbortReason.TOO_SHORT,
                AbortReason.NOT_CORRECTED,
            }
            continue
        keys += 1
        assert ends.alice.state is ends.bob.state is State.DONE
        assert raw_key(ends.alice) == raw_key(ends.bob)
        assert same_key(ends)
        assert ends.alice.report == ends.bob.report
        assert ends.alice.report.key > 0
    assert keys > 80


def test_a_long_session_has_a_key_of_the_length_of_the_finite_key_bound() -> None:
    rng = np.random.default_rng(1)
    parameters = Parameters()
    ends = make_ends(rng, parameters)
    ends.run(*(bb84(rng, 60_000, NOISE) for _ in range(3)))
    report = ends.alice.report
    assert report.qber is not None
    length = finite_key_length(
        report.sifted - report.sample,
        report.sample,
        report.qber,
        report.leaked + 128,  # the tag of verification
        parameters.eps_sec,
        parameters.eps_cor,
    )
    assert report.key == length > 15_000
    assert same_key(ends)


def test_entangled_pairs_that_either_end_may_miss_give_the_same_key() -> None:
    rng = np.random.default_rng(2)
    alices, bobs = bb84(rng, PHOTONS, NOISE)
    alices.outcomes[rng.random(PHOTONS) < 0.2] = NO_CLICK
    ends = make_ends(rng)
    ends.run((alices, bobs))
    both = (alices.outcomes != NO_CLICK) & (bobs.outcomes != NO_CLICK)
    assert ends.alice.report.sifted == np.count_nonzero(both & (alices.bases == bobs.bases))
    assert same_key(ends)


def test_ldpc_codes_give_the_same_key_at_both_ends_in_ten_messages() -> None:
    rng = np.random.default_rng(18)
    keys = 0
    for _ in range(30):
        ends = make_ends(rng, replace(SHORT, reconciliation=Reconciliation.LDPC))
        ends.run(bb84(rng, 10_000, NOISE))
        if ends.alice.failure:
            assert failures(ends) == [AbortReason.NOT_CORRECTED] * 2
        else:
            assert same_key(ends)
            assert len(ends.log) == 10
            keys += 1
    assert keys >= 27


def test_an_announcement_may_come_before_the_light_has_ended_at_alice() -> None:
    rng = np.random.default_rng(3)
    ends = make_ends(rng)
    blocks = [bb84(rng, PHOTONS, NOISE) for _ in range(3)]
    ends.to_bob(ends.alice.start())
    for _alices, bobs in blocks:
        ends.to_alice(ends.bob.add_block(bobs))
    ends.deliver()
    for alices, _bobs in blocks:
        ends.to_bob(ends.alice.add_block(alices))
    ends.to_bob(ends.alice.distil())
    ends.deliver()
    assert same_key(ends)


@pytest.mark.parametrize("spied", [0.0, 0.25, 0.5, 1.0])
def test_intercept_resend_of_a_fraction_gives_a_quarter_of_it_as_qber(spied: float) -> None:
    rng = np.random.default_rng(4)
    alices, bobs = bb84(rng, 400_000, noise=0.0, spied=spied)
    ends = make_ends(rng, replace(SHORT, test_fraction=0.5))
    ends.run((alices, bobs))
    report = ends.alice.report
    assert report.qber is not None
    error = (spied / 4 * (1 - spied / 4) / report.sample) ** 0.5
    assert abs(report.qber - spied / 4) <= 5 * error
    if spied / 4 > SHORT.max_qber:
        assert failures(ends) == [AbortReason.NOISY] * 2
    else:
        assert ends.alice.key is not None


def test_nothing_is_delivered_above_the_threshold() -> None:
    rng = np.random.default_rng(5)
    delivered = 0
    for _ in range(40):
        ends = make_ends(rng, replace(SHORT, max_qber=0.05))
        ends.run(bb84(rng, PHOTONS, 0.05))
        qber = ends.alice.report.qber
        assert qber is not None
        assert (qber > 0.05) == (ends.alice.state is State.ABORTED)
        if qber > 0.05:
            assert failures(ends) == [AbortReason.NOISY] * 2
        delivered += ends.alice.key is not None
    assert 8 < delivered < 32


def test_no_key_comes_of_too_few_photons() -> None:
    rng = np.random.default_rng(6)
    for photons in (1, 4, 5_000):
        ends = make_ends(rng, Parameters())
        ends.run(bb84(rng, photons, NOISE))
        assert failures(ends) == [AbortReason.TOO_SHORT] * 2


def test_ends_with_different_parameters_make_no_key() -> None:
    rng = np.random.default_rng(7)
    ends = make_ends(rng, SHORT, replace(SHORT, max_qber=0.09))
    ends.run(bb84(rng, PHOTONS, NOISE))
    assert failures(ends) == [AbortReason.PARAMETERS] * 2


def test_keys_that_still_differ_are_not_delivered() -> None:
    rng = np.random.default_rng(8)
    ends = make_ends(rng)

    def spoil(_number: int, data: bytes) -> list[bytes]:
        if ends.bob.state is State.CONFIRMING and ends.alice.state is State.RECONCILING:
            ends.alice._raw[0] ^= 1
        return [data]

    ends.change = spoil
    ends.run(bb84(rng, PHOTONS, NOISE))
    assert failures(ends) == [AbortReason.NOT_CORRECTED] * 2


def flip(data: bytes, position: int) -> bytes:
    changed = bytearray(data)
    changed[position // 8 % len(data)] ^= 1 << position % 8
    return bytes(changed)


def a_log() -> list[bytes]:
    ends = make_ends(np.random.default_rng(9))
    ends.run(bb84(np.random.default_rng(10), PHOTONS, NOISE))
    assert ends.alice.key is not None
    return ends.log


LOG = a_log()
# Every kind of message: the middle of the session is questions and answers.
TAMPERED = [*range(8), *range(8, len(LOG) - 5, 9), *range(len(LOG) - 5, len(LOG))]


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize("number", TAMPERED)
@pytest.mark.parametrize("attack", ["flip", "cut", "replay", "swap", "drop"])
def test_no_end_has_a_key_after_a_message_was_tampered_with(attack: str, number: int) -> None:
    rng = np.random.default_rng(9)
    ends = make_ends(rng)

    def change(now: int, data: bytes) -> list[bytes]:
        if now != number:
            return [data]
        match attack:
            case "flip":
                return [flip(data, number * 1_000_003)]
            case "cut":
                return [data[:-1]]
            case "replay":  # of a message that went the same way, if there was one
                return [LOG[number - 2] if number > 1 else LOG[0][:-16] + bytes(16)]
            case "swap":  # the right content, in the place of another message
                return [LOG[(number + 2) % len(LOG)]]
        return []

    ends.change = change
    ends.run(bb84(np.random.default_rng(10), PHOTONS, NOISE))
    if attack != "drop":
        assert set(failures(ends)) <= {
            AbortReason.FORGED,
            AbortReason.MALFORMED,
            AbortReason.PROTOCOL,
        }
    elif number < len(LOG) - 1:
        assert ends.alice.key is None
        assert ends.bob.key is None


def test_replays_after_the_end_change_nothing() -> None:
    rng = np.random.default_rng(9)
    ends = make_ends(rng)
    ends.run(bb84(np.random.default_rng(10), PHOTONS, NOISE))
    for message in LOG:
        for end in (ends.alice, ends.bob):
            assert end.receive(message) == []
            assert end.state is State.DONE


def test_a_key_is_withdrawn_when_the_other_end_aborts_after_all() -> None:
    rng = np.random.default_rng(9)
    ends = make_ends(rng)
    last = len(LOG) - 1
    ends.change = lambda number, data: [] if number == last else [data]
    ends.run(bb84(np.random.default_rng(10), PHOTONS, NOISE))
    assert ends.bob.key is not None
    ends.to_bob(ends.alice.cancel("bob did not confirm in 10 s"))
    ends.deliver()
    assert failures(ends) == [AbortReason.CANCELLED] * 2


def test_ends_that_share_no_key_refuse_each_other() -> None:
    rng = np.random.default_rng(11)
    mine, other = make_ends(rng), make_ends(rng)
    answers = mine.bob.receive(other.alice.start()[0])
    assert mine.bob.failure is not None
    assert mine.bob.failure.reason is AbortReason.FORGED
    assert [unframe(answer).session for answer in answers] == [SESSION]


def test_authentication_consumes_exactly_one_pad_for_each_message() -> None:
    rng = np.random.default_rng(12)
    ends = make_ends(rng)
    ends.run(bb84(rng, PHOTONS, NOISE))
    points = 2
    for end in (ends.alice, ends.bob):
        assert end.report.authentication == 128 * (points + len(ends.log))


@pytest.mark.parametrize("messages", range(1, 12))
def test_ends_that_run_out_of_authentication_key_both_say_so(messages: int) -> None:
    rng = np.random.default_rng(13)
    ends = make_ends(rng, messages=messages)
    ends.run(bb84(rng, PHOTONS, NOISE))
    assert set(failures(ends)) == {AbortReason.NO_AUTHENTICATION_KEY}


def test_alice_does_not_take_a_key_whose_length_bob_does_not_confirm(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(19)
    ends = make_ends(rng)
    monkeypatch.setattr(ends.bob, "_amplify", lambda _message: [Confirm(1)])
    ends.run(bb84(rng, PHOTONS, NOISE))
    assert failures(ends) == [AbortReason.PROTOCOL] * 2


def test_bob_does_not_take_a_key_longer_than_is_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(20)
    ends = make_ends(rng)
    amplify = ends.alice._amplify
    monkeypatch.setattr(ends.alice, "_amplify", lambda length: amplify(length + 1))
    ends.run(bb84(rng, PHOTONS, NOISE))
    assert failures(ends) == [AbortReason.PROTOCOL] * 2


def test_bob_counts_the_leak_that_alice_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(21)
    ends = make_ends(rng)
    verify = ends.bob._verify
    monkeypatch.setattr(ends.bob, "_verify", lambda: replace(verify(), leaked_bits=1))
    ends.run(bb84(rng, PHOTONS, NOISE))
    assert failures(ends) == [AbortReason.PROTOCOL] * 2


def test_a_message_out_of_place_ends_the_session() -> None:
    rng = np.random.default_rng(14)
    ends = make_ends(rng)
    ends.to_bob(ends.alice.start())
    ends.to_bob(ends.alice.start())
    ends.deliver()
    assert failures(ends) == [AbortReason.PROTOCOL] * 2


def test_a_block_of_another_size_ends_the_session() -> None:
    rng = np.random.default_rng(15)
    ends = make_ends(rng)
    ends.run((bb84(rng, 10, 0)[0], bb84(rng, 11, 0)[1]))
    assert failures(ends) == [AbortReason.PROTOCOL] * 2


def test_a_block_after_the_last_one_is_the_callers_mistake() -> None:
    rng = np.random.default_rng(16)
    ends = make_ends(rng)
    alices, bobs = bb84(rng, PHOTONS, NOISE)
    ends.run((alices, bobs))
    with pytest.raises(ValueError, match="new session"):
        ends.alice.add_block(alices)
    with pytest.raises(ValueError, match="new session"):
        ends.bob.add_block(bobs)


@pytest.mark.parametrize(
    ("name", "value"),
    [("max_qber", 0.11), ("test_fraction", 1.0), ("eps_sec", 0.0), ("eps_cor", 1e-40)],
)
def test_parameters_that_allow_no_secure_key_are_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=name):
        replace(Parameters(), **{name: value})


def test_records_are_checked_when_they_are_made() -> None:
    ones = np.ones(3, dtype=np.uint8)
    for bases, outcomes in ((ones[:2], ones), (2 * ones, ones), (ones, 3 * ones)):
        with pytest.raises(ValueError, match=r"basis|bases|outcome"):
            Record(bases, outcomes)
