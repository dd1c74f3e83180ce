"""One second of the network takes K seconds here."""

from pathlib import Path

import pytest

from wire.config import AgentConfig, BadConfig
from wire.network_time import REAL_TIME, NetworkTime

SINCE_NS = 1_700_000_000_000_000_000


def test_both_clocks_agree_where_they_begin_and_then_the_network_is_k_times_slower() -> None:
    time = NetworkTime(250.0, SINCE_NS)
    assert time.network_ns(SINCE_NS) == time.wall_ns(SINCE_NS) == SINCE_NS
    assert time.network_ns(SINCE_NS + 1_000_000_000) == SINCE_NS + 4_000_000
    assert time.wall_ns(SINCE_NS + 4_000_000) == SINCE_NS + 1_000_000_000
    assert time.network_s(1.0) == 0.004
    assert time.wall_s(0.004) == 1.0


@pytest.mark.parametrize("scale", [1.0, 1.5, 40_000.0, 1e9])
def test_what_is_converted_there_and_back_is_the_same_to_the_nanosecond(scale: float) -> None:
    time = NetworkTime(scale, SINCE_NS)
    for network_ns in (SINCE_NS, SINCE_NS + 1, SINCE_NS + 123_457):
        assert time.network_ns(time.wall_ns(network_ns)) == network_ns


def test_in_real_time_nothing_is_rounded_however_long_it_is_since_the_beginning() -> None:
    assert REAL_TIME.network_ns(SINCE_NS + 1) == SINCE_NS + 1
    assert REAL_TIME.wall_ns(SINCE_NS + 1) == SINCE_NS + 1


@pytest.mark.parametrize("scale", [0.0, 0.5, -3.0, 2e9, float("nan"), float("inf")])
def test_a_scale_that_cannot_be_is_refused_with_the_range(scale: float) -> None:
    with pytest.raises(ValueError, match=r"choose 1 to 1e\+09 seconds here"):
        NetworkTime(scale)


def test_a_program_does_not_start_with_a_scale_that_cannot_be(tmp_path: Path) -> None:
    config = AgentConfig("q1", "127.0.0.1:1", [], "", "", "secret", [], time_scale=0.5)
    config.write(tmp_path / "q1.json")
    with pytest.raises(BadConfig, match=r"time scale 0\.5"):
        AgentConfig.read(tmp_path / "q1.json")
