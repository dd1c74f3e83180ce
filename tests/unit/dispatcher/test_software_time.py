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


def test_of_a_wait_only_that_is_software_in_which_no_light_was_under_way() -> None:
    software = SoftwareTime()
    software.goes_on(100, 200)
    software.goes_on(400, 500)
    software.waited("bob", 150, 550, decays=False)  # 250 of 400: 200 to 400, and 500 to 550
    told = software.message()
    assert (told.largest_wait_share, told.longest_ns) == (0.625, 250)
    assert told.largest_decaying_share == 0
    assert told.run_share == 0.5  # 200 to 400, of 100 to 500


def test_the_largest_share_and_the_longest_time_may_be_of_different_waits() -> None:
    software = SoftwareTime()
    software.goes_on(0, 1000)
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
    assert activity.idle_share == pytest.approx(1 - 400 / 994)
    assert activity.within(900, 1000) == 40


def test_a_wait_for_news_along_the_copper_is_no_software() -> None:
    """Bob waits 300 ns; what alice measured at 50 is there at 150, what charlie did nowhere."""
    software = SoftwareTime({"alice": {"bob": 100e-9}, "bob": {"alice": 100e-9}})
    software.news("alice", 50)
    software.news("bob", 200)  # alice may wait for that, bob does not
    software.news("charlie", 200)
    software.waited("bob", 0, 300, decays=True)
    assert software.message().longest_ns == 200
    software.waited("alice", 200, 300, decays=True)
    assert software.message().longest_ns == 200
