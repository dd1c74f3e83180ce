"""Changes of fibres against a real dispatcher that runs as its own process."""

from pathlib import Path

import pytest
from test_fault import logged, network

from qmn.__main__ import described
from qmn.changes import fibers
from qmn.running import network as running


def run(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, words: str
) -> tuple[int, str]:
    """Run a verb with private folders under a root; return its status and what it says."""
    monkeypatch.setattr(
        fibers,
        "dispatcher_of_running_network",
        lambda: running.dispatcher_of_running_network(root),
    )
    whole = ["set", *words.split()]
    arguments = described(whole).parse_args(whole)
    status = arguments.call(arguments)
    output = capsys.readouterr()
    return status, output.out + output.err


def test_orders_reach_the_fibres_of_the_running_network(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with network(tmp_path) as (_process, log):
        for words, line, text in (
            ("calibrate alice q1", "2 fibres between alice and q1: calibrated\n", "calibrate"),
            (
                "classical q1 alice 2.5",
                "2 fibres between q1 and alice: classical light of 2.5 mW\n",
                "classical light 2.5 mW",
            ),
            (
                "tap q1 alice 0.25",
                "2 fibres between q1 and alice: 0.25 of the photons are measured and sent on\n",
                "tapped 0.25",
            ),
        ):
            assert run(tmp_path, capsys, monkeypatch, words) == (0, line)
            assert len(logged(log, text, 4)) == 4


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ("calibrate alice bob", "no fibre joins alice and bob; alice is joined to q1"),
        ("classical alice q1 2000", "classical_mw 2000.0: choose 0 to 1000"),
        ("tap alice q1 1.5", "tapped 1.5: choose 0 to 1"),
    ],
)
def test_an_order_that_cannot_be_followed_is_named(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: str,
    text: str,
) -> None:
    with network(tmp_path):
        status, output = run(tmp_path, capsys, monkeypatch, words)
        assert status == 1
        assert text in output
        assert output.count("\n") == 1


def test_where_no_network_runs_the_verbs_say_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    status, output = run(tmp_path, capsys, monkeypatch, "calibrate alice q1")
    assert (status, "no network runs on this machine" in output) == (1, True)
