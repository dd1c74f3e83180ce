"""Key distribution with a third host on the fibre, over loopback, with a real dispatcher."""

import asyncio
import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from forked_python import Forked
from limits import SOON_S
from stacks_scene import accepted, live_qubits, network, requested

from applications.interception.passing import rate_of
from applications.qkd.alice import Alice
from applications.qkd.bob import Bob
from applications.qkd.sifting import Known
from hosts import network_loop
from hosts.hardware.replies import Received
from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.options import MAX_RATE_HZ
from hosts.service_socket import ServiceSocket
from hosts.serving import processing
from hosts.stack_socket import QuantumSocketError
from wire.config import HostConfig
from wire.outcomes import NO_CLICK

BY_EVE = {"bb84": [(1, 6), (7, 2)], "bbm92": [(4, 1), (5, 6), (7, 2)]}
COUNT = 100_000

protocols = pytest.mark.parametrize("protocol", list(BY_EVE))


def keys(folder: Path) -> list[Path]:
    """Return the files of all key stores."""
    return [path for path in (folder / "keys").rglob("*") if path.is_file()]


def intercepted(folder: Path, protocol: str, fraction: float, **options: Any) -> Any:
    """Run a session with eve on the fibre; return the ends' summaries, and what she saw."""

    def asked() -> Any:
        with ServiceSocket(folder / "eve.sock") as eve:
            eve.settimeout(SOON_S)
            blocks = eve.intercept(fraction)
            report = requested(folder, protocol, **options)
            eve.shutdown()
            assert list(blocks) == []  # shutdown has read them
        return *report, eve.summary

    async def run() -> Any:
        async with network(folder, paths=BY_EVE[protocol]):
            return await asyncio.to_thread(asked)

    return network_loop.run(run())


@pytest.mark.by_day(every=2)
@protocols
@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.2])
def test_the_error_rate_is_a_quarter_of_the_fraction(
    tmp_path: Path, protocol: str, fraction: float
) -> None:
    options = {"count": COUNT, "test_fraction": 0.5}
    alice, bob, eve = intercepted(tmp_path, protocol, fraction, **options)
    qber = fraction / 4
    error = sqrt(qber * (1 - qber) / alice["disclosed_bits"])
    for summary in (alice, bob):
        assert abs(summary["qber"] - qber) <= 5 * error
    assert eve["lost_blocks"] == 0
    assert eve["photons"] == alice["photons"]
    spread = 5 * sqrt(eve["photons"] * fraction * (1 - fraction))
    assert abs(eve["measured"] - fraction * eve["photons"]) <= spread
    assert eve["zeros"] + eve["ones"] == eve["measured"]
    assert keys(tmp_path)


@protocols
def test_either_basis_has_a_quarter_of_the_fraction_in_errors(
    tmp_path: Path, protocol: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An eve who measured in Z alone would leave as many errors, all of them in X."""
    hers, his = blocks_of(Alice, monkeypatch), blocks_of(Bob, monkeypatch)
    intercepted(tmp_path, protocol, 0.2, count=20_000, test_fraction=0.5)
    assert len(hers) == len(his) > 0
    for basis in (0, 1):  # Z, X
        wrong = count = 0
        for mine, yours in zip(hers, his, strict=True):
            own, other = mine.of(yours.clicked), yours.of(yours.clicked)
            same = (own.bases == basis) & (other.bases == basis) & (own.outcomes != NO_CLICK)
            count += int(np.count_nonzero(same))
            wrong += int(np.count_nonzero(own.outcomes[same] != other.outcomes[same]))
        assert count > 5_000
        assert abs(wrong - count * 0.2 / 4) <= 5 * sqrt(count * 0.05 * 0.95), basis


def blocks_of(end: type[Alice] | type[Bob], monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the list of what an end will know of its blocks of light."""
    known: list[Known] = []
    add_block: Callable[..., list[bytes]] = end.add_block

    def noted(self: Any, record: Known) -> list[bytes]:
        known.append(record)
        return add_block(self, record)

    monkeypatch.setattr(end, "add_block", noted)
    return known


@protocols
def test_who_measures_everything_leaves_no_key_at_either_end(tmp_path: Path, protocol: str) -> None:
    def asked() -> tuple[str, str]:
        with (
            ThreadPoolExecutor(1) as pool,
            ServiceSocket(tmp_path / "eve.sock") as eve,
            ServiceSocket(tmp_path / "alice.sock") as alice,
        ):
            listening: Future[None] = Future()
            bob = pool.submit(accepted, tmp_path, protocol, listening)
            listening.result(SOON_S)
            for end in (eve, alice):
                end.settimeout(SOON_S)
            blocks = eve.intercept()
            with pytest.raises(QuantumSocketError) as hers:
                list(alice.request(protocol, ("bob", 9), count=20_000))
            with pytest.raises(QuantumSocketError) as his:
                bob.result(SOON_S)
            first = next(blocks)
            assert first["zeros"] + first["ones"] == first["photons"] > 0
            return str(hers.value), str(his.value)

    async def run() -> tuple[str, str]:
        async with network(tmp_path, paths=BY_EVE[protocol]):
            report = await asyncio.to_thread(asked)
            assert await live_qubits(tmp_path) == 0
            return report

    for report in network_loop.run(run()):
        found = re.search(r"no key: (\d+) of (\d+) test bits are wrong", report)
        assert found, report
        wrong, tested = map(int, found.groups())
        assert abs(wrong - tested / 4) <= 5 * sqrt(tested * 3 / 16)
    assert keys(tmp_path) == []


def test_light_stops_at_a_host_on_the_fibre_that_does_nothing(tmp_path: Path) -> None:
    def asked() -> str:
        with ThreadPoolExecutor(1) as pool, ServiceSocket(tmp_path / "alice.sock") as alice:
            listening: Future[None] = Future()
            bob = pool.submit(accepted, tmp_path, "bb84", listening)
            listening.result(SOON_S)
            alice.settimeout(SOON_S)
            with pytest.raises(QuantumSocketError) as caught:
                list(alice.request("bb84", ("bob", 9), count=100))
            with pytest.raises(QuantumSocketError):
                bob.result(SOON_S)
            return str(caught.value)

    async def run() -> str:
        async with network(tmp_path, paths=BY_EVE["bb84"]):
            return await asyncio.to_thread(asked)

    assert "no photon was measured by both ends" in network_loop.run(run())


def test_the_application_tells_what_was_seen_when_it_is_told_to_end(tmp_path: Path) -> None:
    def asked() -> tuple[list[dict[str, Any]], dict[str, Any], int]:
        command = [sys.executable, "-m", "hosts.applications.intercept", "--stack"]
        with Forked(
            [*command, str(tmp_path / "eve.sock"), "0.1"], stdout=subprocess.PIPE, text=True
        ) as eve:
            assert eve.stdout
            begun = json.loads(eve.stdout.readline())
            try:
                alice, _bob = requested(tmp_path, "bb84", count=20_000)
            finally:
                eve.send_signal(signal.SIGTERM)
            text, _ = eve.communicate(timeout=SOON_S)
        return [begun, *map(json.loads, text.splitlines())], alice, eve.returncode

    async def run() -> tuple[list[dict[str, Any]], dict[str, Any], int]:
        async with network(tmp_path, paths=BY_EVE["bb84"]):
            return await asyncio.to_thread(asked)

    (begun, *blocks, done), alice, status = network_loop.run(run())
    assert status == 0
    assert begun == {"event": "intercepting", "fraction": 0.1, "attack": "resend"}
    assert (done["event"], done["fraction"]) == ("done", 0.1)
    assert done["blocks"] == len(blocks)
    assert sum(block["photons"] for block in blocks) == done["photons"] == alice["photons"]


@pytest.mark.parametrize(
    ("host", "options", "words"),
    [
        ("alice", {"fraction": 1.0}, "interception needs 2 fibres, this host has 1"),
        ("eve", {"fraction": 1.5}, "fraction 1.5: choose 0 to 1"),
        ("eve", {"fraction": True}, "fraction True"),
        ("eve", {"fraction": "all"}, "fraction 'all'"),
        ("eve", {"fraction": float("nan")}, "fraction nan"),
        ("eve", {"wavelength_pm": 7}, "wavelength_pm 7: choose"),
        (
            "eve",
            {"basis": "Z"},
            "a session has no basis: choose one of fraction, attack",
        ),
        ("eve", {"attack": "blind"}, "attack 'blind': choose one of resend, split"),
        ("eve", {"attack": "split", "fraction": 0.5}, "split is of every pulse, choose 1"),
        ("eve", {"expected_db": 3.0}, "are of split: leave them out"),
        ("eve", {"attack": "split", "expected_db": -1.0}, "expected_db -1.0: choose 0 to 1000"),
        (
            "eve",
            {"attack": "split", "expected_db": 3.0, "onward_db": 4.0},
            "onward_db is 4.0, more than expected_db 3.0",
        ),
    ],
)
def test_what_cannot_be_asked_is_refused_with_the_remedy(
    tmp_path: Path, host: str, options: dict[str, Any], words: str
) -> None:
    def refused() -> str:
        with ServiceSocket(tmp_path / f"{host}.sock") as asking:
            asking.settimeout(SOON_S)
            with pytest.raises(QuantumSocketError) as caught:
                asking.intercept(**options)
            return str(caught.value)

    async def run() -> str:
        async with network(tmp_path):
            return await asyncio.to_thread(refused)

    assert words in network_loop.run(run())


def test_light_is_sent_on_as_fast_as_it_came() -> None:
    assert rate_of(Received(1001, 5_000, 1_005_000)) == 1_000_000
    assert rate_of(Received(1, 5_000, 5_000)) == MAX_RATE_HZ
    assert rate_of(Received(2, 0, 10**12)) == 1


def test_a_host_without_the_package_refuses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processing, "INTERCEPTIONS", ())
    config = HostConfig("eve", "10.0.0.5", [], "", "", "", "", "", seed=1)
    with pytest.raises(SessionError, match="install the package applications"):
        processing.interception(config, lambda _pm: pytest.fail("no QNIC is needed"), {})
