"""Software is what is left of a wait when all that is physical is taken away."""

import random

import pytest

from dispatcher.layer.software_time import Activity, SoftwareTime


def test_intervals_in_any_order_cover_what_their_moments_cover() -> None:
    """The oracle is a set of moments."""
    draws = random.Random(5)
    for _ in range(200):
        activity, moments = Activity(), set[int]()
        for _ in range(draws.randrange(1, 12)):
            begin = draws.randrange(60)
            end = begin + draws.randrange(12)
            activity.note(begin, end)
            moments |= set(range(begin, end))
        for _ in range(10):
            begin = draws.randrange(60)
            end = begin + draws.randrange(1, 30)
            assert activity.within(begin, end) == len(moments & set(range(begin, end)))


def test_a_wait_in_which_nothing_came_was_software() -> None:
    """And of the run all in which no light was under way: 200 to 400, of 100 to 500."""
    software = SoftwareTime()
    software.switches(0, 10)  # before the first light
    software.goes_on(100, 200)
    software.goes_on(400, 500)
    software.switches(600, 700)  # behind the last
    software.light("charlie", 100, "bob", 200)
    software.waited("bob", 200, 300, decays=False)
    told = software.message()
    assert (told.largest_wait_share, told.longest_ns) == (1.0, 100)
    assert told.largest_decaying_share == 0
    assert told.run_share == 0.5


def test_light_that_comes_while_a_qubit_waits_takes_its_time() -> None:
    """At a repeater the second light is sent 30 after the first came, and used 20 after it came."""
    software = SoftwareTime()
    software.light("alice", 0, "r1", 100)
    software.light("bob", 130, "r1", 400)
    software.waited("r1", 100, 420, decays=True)
    told = software.message()
    assert told.longest_ns == 30 + 20
    assert told.largest_decaying_share == pytest.approx(50 / 320)


def test_a_pulse_train_that_is_still_coming_is_no_software() -> None:
    """The first photon waits from 100 on, the last comes at 900."""
    software = SoftwareTime()
    software.light("charlie", 0, "bob", 900)
    software.waited("bob", 100, 950, decays=True)
    assert software.message().longest_ns == 50


def test_the_largest_share_and_the_longest_time_may_be_of_different_waits() -> None:
    software = SoftwareTime()
    software.light("charlie", 0, "bob", 1000)
    software.waited("bob", 1000, 1010, decays=True)  # all of it
    software.waited("bob", 0, 1500, decays=True)  # a third
    told = software.message()
    assert (told.largest_decaying_share, told.longest_ns) == (1.0, 500)


def test_a_long_run_forgets_its_oldest_light_but_not_its_share(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("dispatcher.layer.software_time.MOST_INTERVALS", 10)
    activity = Activity()
    for begin in range(0, 1000, 10):
        activity.note(begin, begin + 4)
    assert activity.idle_share(994) == pytest.approx(1 - 400 / 994)
    assert activity.within(900, 1000) == 40


def test_a_wait_for_news_along_the_copper_is_no_software() -> None:
    """Teleportation: charlie tells alice at once that light has come, she measures, tells bob.

    Light comes at 1000. charlie's word is at alice at 1100, she measures at 1130; that is at bob at
    1230, and he has used his qubits at 1270.
    """
    apart = {name: dict.fromkeys(("alice", "bob", "charlie"), 100e-9) for name in ("alice", "bob")}
    software = SoftwareTime(apart)
    for receiver in ("alice", "bob"):
        software.light("charlie", 900, receiver, 1000)
    software.news("alice", 1130)
    software.news("alice", 1250)  # too late to be known
    software.waited("bob", 1000, 1270, decays=True)
    assert software.message().longest_ns == 30 + 40


def test_word_of_a_pulse_train_is_not_there_before_its_last_pulse_has_left() -> None:
    """It leaves from 0 to 800, and is at bob, who is nearer, from 50 to 850.

    charlie's word of it is at alice at 900.
    """
    software = SoftwareTime({"alice": {"charlie": 100e-9}})
    software.light("charlie", 0, "charlie", 800)
    software.light("charlie", 0, "bob", 850)
    software.waited("alice", 200, 912, decays=True)
    assert software.message().longest_ns == 12


def test_light_that_takes_no_time_does_not_hold_up_the_way_back() -> None:
    software = SoftwareTime()
    software.light("charlie", 70, "bob", 70)
    software.waited("bob", 0, 80, decays=True)
    assert software.message().longest_ns == 80


def test_deeds_at_one_moment_end_the_way_back() -> None:
    software = SoftwareTime()
    for node in ("alice", "bob"):
        software.news(node, 50)
    software.waited("bob", 0, 80, decays=True)
    assert software.message().longest_ns == 80


def test_old_deeds_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dispatcher.layer.software_time.MOST_DEEDS", 10)
    software = SoftwareTime()
    for moment in range(1000):
        software.news("alice", moment)
    software.waited("bob", 990, 1000, decays=True)
    assert software.message().longest_ns == 10
