"""How often a host announces its fibres: soon at first, then ever more rarely."""

from itertools import accumulate, islice, pairwise

from hosts.hardware.announce import pauses
from wire.lldp import PERIOD_S, period_s


def test_a_network_that_takes_longer_to_start_waits_a_quarter_of_that_time_more_at_most() -> None:
    moments = [0.0, *accumulate(islice(pauses(lambda: 30.0), 40))]
    for before, after in pairwise(moments):
        assert after - before <= max(0.2, before / 4) + 1e-9


def test_in_the_end_there_is_one_a_period_which_may_become_longer() -> None:
    longest_s = PERIOD_S
    waited = pauses(lambda: longest_s)
    assert list(islice(waited, 100, 110)) == [PERIOD_S] * 10
    longest_s = 20.0
    assert list(islice(waited, 10)) == [20.0] * 10


def test_hosts_of_a_larger_network_announce_no_more_fibres_a_second() -> None:
    """Up to some hundreds; from there on as rarely as IEEE 802.1AB has it by default."""
    assert period_s(20) == 5.0
    assert 500 / period_s(500) == 250 / period_s(250) == 25.0
    assert period_s(2_558) == 30.0
