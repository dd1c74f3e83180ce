"""Statistics of many times, and proofs that a path was made."""

import io
import socket
import threading
from pathlib import Path

import pytest

from evidence.bench.measurement import Times
from evidence.bench.path_benchmarks import parts, ratio
from evidence.bench.path_requests import NoPath, Openings, answered, time_ns, wait_until_closed
from wire.metadata.blocks import Emit
from wire.metadata.setup import Answer
from wire.metadata.vocabulary import Reason

OPEN = b"2026-11-21T08:00:00.000000000Z q1       open          port=1 1 -> 2\n"
CLOSE = b"2026-11-21T08:00:00.000000001Z q1       close         port=1 1 -> 2\n"
OTHER = b"2026-11-21T08:00:00.000000002Z alice    create        photons=8\n"


def test_median_rate_and_tail_of_many_times() -> None:
    times = Times([float(number) for number in range(1, 51)], 0.5)
    times += Times([float(number) for number in range(51, 102)], 0.51)
    assert times.p50_ms == 51.0
    assert times.per_s == pytest.approx(100.0)
    assert str(times) == "median 51 ms, p99 100 ms, n 101"


def test_a_ratio_is_that_of_the_medians() -> None:
    assert ratio(Times([2.0, 5.0, 100.0]), Times([1.0, 2.0, 3.0])) == "2.50 times 2.00 ms"


def test_rounds_share_a_count_and_have_one_turn_at_least() -> None:
    assert parts(500, 2) == [250, 250]
    assert parts(7, 2) == [3, 4]
    assert parts(0, 2) == [1, 1]


def test_openings_are_counted_from_the_end_of_the_log_and_by_whole_lines(tmp_path: Path) -> None:
    file = tmp_path / "quantum.log"
    file.write_bytes(OPEN * 5)
    with file.open("rb") as log, file.open("ab", buffering=0) as written:
        openings = Openings(log)
        openings.read()
        assert (openings.opened, openings.closed) == (0, 0)
        written.write(OTHER + OPEN + CLOSE[:40])
        openings.read()
        assert (openings.opened, openings.closed) == (1, 0)
        written.write(CLOSE[40:])
        openings.read()
        assert (openings.opened, openings.closed) == (1, 1)


def test_times_of_the_log_are_those_of_the_clock() -> None:
    # `date -d 2026-11-22T15:23:39Z +%s`
    assert time_ns("2026-11-22T15:23:39.978776440Z") == 1_795_361_019_978_776_440


def test_a_path_that_stays_open_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evidence.bench.path_requests.CLOSE_TIMEOUT_S", 0.01)
    openings = Openings(io.BytesIO())
    openings.opened = 3
    with pytest.raises(NoPath, match="3 cross-connects stay open"):
        wait_until_closed(openings, 0)
    with pytest.raises(NoPath, match="no cross-connect has opened"):
        wait_until_closed(openings, 3)


@pytest.mark.parametrize(
    ("sent", "problem"),
    [
        (b"", "closed without an answer"),
        (Answer(1, Reason.OK).encode()[:-1], "closed without an answer"),
        (Emit(1, 2, 3, 4).encode(), "Emit instead of an answer"),
    ],
)
def test_only_an_answer_is_one(sent: bytes, problem: str) -> None:
    near, far = socket.socketpair()
    with near:
        with far:
            far.sendall(sent)
        with pytest.raises(NoPath, match=problem):
            answered(near)


def test_an_answer_may_come_in_pieces() -> None:
    answer = Answer(7, Reason.NO_LISTENER, "nobody listens")
    near, far = socket.socketpair()
    with near, far:
        near.settimeout(5.0)
        first, rest = answer.encode()[:5], answer.encode()[5:]
        far.sendall(first)
        later = threading.Timer(0.05, far.sendall, [rest])
        later.start()
        assert answered(near) == answer
        later.join()
