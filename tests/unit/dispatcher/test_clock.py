"""The clock of the network is set by the clock that stamps captures, also on a busy machine."""

import pytest

from dispatcher import clock
from dispatcher.clock import NetworkClock

BEHIND_NS = 1_700_000_000_000_000_000  # the monotonic clock
INTERRUPTION_NS = 2_000_000


class BusyMachine:
    """Both clocks of a machine, where others have the processor before some readings."""

    def __init__(self, interrupted: set[int]) -> None:
        self._now_ns, self._readings, self._interrupted = 5_000, 0, interrupted

    def monotonic_ns(self) -> int:
        self._now_ns += INTERRUPTION_NS if self._readings in self._interrupted else 50
        self._readings += 1
        return self._now_ns

    def time_ns(self) -> int:
        return self.monotonic_ns() + BEHIND_NS


@pytest.mark.parametrize("interrupted", [set(), {1}, {2}, {1, 2, 4, 5}, set(range(20))])
def test_an_interruption_between_two_readings_does_not_set_the_clock(
    monkeypatch: pytest.MonkeyPatch, interrupted: set[int]
) -> None:
    machine = BusyMachine(interrupted)
    monkeypatch.setattr(clock, "time", machine)
    network = NetworkClock()
    monkeypatch.setattr(machine, "_interrupted", set())
    assert abs(machine.time_ns() - network.now_ns()) <= 2 * 50
