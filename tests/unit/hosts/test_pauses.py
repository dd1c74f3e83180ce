"""How long hosts wait before they ask again for light that others have."""

from itertools import accumulate, islice

from hosts.middleware.session.arrangement import growing_pauses
from hosts.timeouts import LONGEST_RETRY_PAUSE_S, RETRY_PAUSE_S

SECONDS = 60.0


def first(asker: str, number: int) -> list[float]:
    return list(islice(growing_pauses(asker), number))


def asked(asker: str) -> int:
    """Return how often somebody asks again in a minute."""
    return sum(at <= SECONDS for at in accumulate(first(asker, 1000)))


def test_each_pause_is_half_to_all_of_a_time_that_doubles_up_to_the_longest() -> None:
    for asker in map(str, range(100)):
        most_s = RETRY_PAUSE_S
        for pause_s in first(asker, 12):
            assert most_s / 2 <= pause_s <= most_s
            most_s = min(2 * most_s, LONGEST_RETRY_PAUSE_S)


def test_hosts_that_were_refused_together_do_not_ask_together_again() -> None:
    """Of 100 that draw uniformly among 500 tenths of a millisecond about 9 meet (birthdays)."""
    seconds = [round(sum(first(str(asker), 1)), 4) for asker in range(100)]
    assert len(set(seconds)) >= 80  # nine fewer in the mean; 3 sigma are nine more


def test_hosts_that_wait_alike_ask_about_as_often() -> None:
    """Pauses are uniform: in the mean 3/4 of the longest, with a variance of 1/48 of its square."""
    mean = SECONDS / (0.75 * LONGEST_RETRY_PAUSE_S)
    sigma = mean**0.5 * (1 / 48) ** 0.5 / 0.75  # of a renewal process
    for asker in map(str, range(20)):
        assert abs(asked(asker) - mean) < 5 * sigma + 3  # the first three pauses are shorter


def test_pauses_of_one_asker_are_its_own_and_the_same_again() -> None:
    assert first("a", 5) == first("a", 5) != first("b", 5)
