"""When a session that is refused asks again by itself."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from stacks_scene import grant, network, requested

from hosts import network_loop
from hosts.middleware.session import arrangement
from hosts.service_socket import ServiceSocket
from hosts.stack_socket import QuantumSocketError
from wire.metadata.setup import Setup
from wire.metadata.vocabulary import Reason, Service, Verdict

MOST_S = (0.1, 0.2, 0.4, 0.8, 0.8, 0.8)  # a pause doubles up to the longest
Judge = Callable[[Setup], Setup]


class Slow:
    """A controller that hears late of the end of a session."""

    def __init__(self, late: int) -> None:
        """Refuse a number of requests after the first."""
        self.late, self.asked = late, 0

    def __call__(self, setup: Setup) -> Setup:
        """Judge a set-up; only those of the opener count."""
        self.asked += setup.service == Service["TELEPORT"]
        if setup.service != Service["TELEPORT"]:
            return grant(setup)
        if 1 < self.asked <= 1 + self.late:
            return replace(setup, verdict=Verdict.REFUSED, reason=Reason.BUSY)
        return grant(setup)


def two_sessions(folder: Path, judge: Judge) -> None:
    """Teleport twice, one session right after the other."""

    async def run() -> None:
        async with network(folder, judge):
            for _ in range(2):
                await asyncio.to_thread(requested, folder, "teleport", count=100)

    network_loop.run(run())


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return the pauses before asking again; only in them does the clock go on."""
    made: list[float] = []

    async def pause(seconds: float, most_s: float) -> None:
        made.append(min(seconds, most_s))

    monkeypatch.setattr(arrangement, "retry_pause", pause)
    monkeypatch.setattr(arrangement, "now_s", lambda: sum(made))
    return made


def test_light_that_this_host_has_just_let_go_is_waited_for(
    tmp_path: Path, pauses: list[float]
) -> None:
    controller = Slow(late=3)
    two_sessions(tmp_path, controller)
    assert controller.asked == 5
    assert len(pauses) == 3


def test_light_that_this_host_has_just_had_of_another_is_waited_for(
    tmp_path: Path, pauses: list[float]
) -> None:
    """Bob asks as soon as his application knows that alice's session is over."""
    asked: list[int] = []

    def judge(setup: Setup) -> Setup:
        if setup.service != Service["TELEPORT"]:
            return grant(setup)
        asked.append(setup.session)
        if len(asked) == 1:
            return grant(setup)
        reason = Reason.BUSY if len(asked) < 5 else Reason.NO_PATH
        return replace(setup, verdict=Verdict.REFUSED, reason=reason)

    async def run() -> None:
        async with network(tmp_path, judge):
            await asyncio.to_thread(requested, tmp_path, "teleport", count=100)
            await asyncio.to_thread(asked_by_bob)

    def asked_by_bob() -> None:
        with ServiceSocket(tmp_path / "bob.sock") as bob:
            list(bob.request("teleport", ("alice", 9), count=100))

    with pytest.raises(QuantumSocketError) as caught:
        network_loop.run(run())
    assert caught.value.reason == Reason.NO_PATH
    assert len(pauses) == 3


def test_light_that_is_not_freed_in_time_is_busy(
    tmp_path: Path, pauses: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refused at 0 s, after 0.05 to 0.1, 0.1 to 0.2 and so on, and for good at 2 s."""
    monkeypatch.setattr(arrangement, "FREEING_TIMEOUT_S", 2.0)
    controller = Slow(late=1000)
    with pytest.raises(QuantumSocketError, match="another session uses these fibres") as caught:
        two_sessions(tmp_path, controller)
    assert caught.value.reason == Reason.BUSY
    assert sum(pauses) == pytest.approx(2.0)
    *grown, _last = pauses
    assert all(most / 2 <= pause <= most for pause, most in zip(grown, MOST_S, strict=False))
    assert controller.asked == 1 + 1 + len(pauses)


def test_light_that_others_have_is_busy_at_once(tmp_path: Path, pauses: list[float]) -> None:
    controller = Slow(late=1000)
    controller.asked = 1
    with pytest.raises(QuantumSocketError, match="another session uses these fibres"):
        two_sessions(tmp_path, controller)
    assert controller.asked == 2
    assert pauses == []
