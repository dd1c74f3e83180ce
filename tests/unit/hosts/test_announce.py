"""How often a host announces its fibres: soon at first, then ever more rarely."""

from itertools import accumulate, islice, pairwise

from hosts.hardware.announce import pauses
from hosts.timeouts import ANNOUNCEMENT_PERIOD_S, ANNOUNCEMENT_TTL_S


def test_a_network_that_takes_longer_to_start_waits_a_quarter_of_that_time_more_at_most() -> None:
    moments = [0.0, *accumulate(islice(pauses(), 40))]
    for before, after in pairwise(moments):
        assert after - before <= max(0.2, before / 4) + 1e-9


def test_in_the_end_there_is_one_a_period_several_before_the_last_is_forgotten() -> None:
    later = list(islice(pauses(), 100, 110))
    assert later == [ANNOUNCEMENT_PERIOD_S] * 10
    assert ANNOUNCEMENT_TTL_S >= 3 * ANNOUNCEMENT_PERIOD_S
