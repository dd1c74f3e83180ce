"""The words of `qmn worker` about a scheduler that cannot be, or is not there."""

import asyncio
import socket

import pytest

from qmn.__main__ import described
from qmn.verbs import worker
from topologies.system.processes.programs import NetworkError


@pytest.mark.parametrize(
    "address",
    ["foo", "", "192.0.2.1:8786", "tcp://192.0.2.1", "tcp://:8786", "tcp://a:b", "http://a:1"],
)
def test_what_is_no_address_is_told_in_one_line(
    address: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = described(["worker"]).parse_args(["worker", address])
    assert arguments.call(arguments) == 1
    output = capsys.readouterr()
    words = f"qmn: scheduler {address!r}: write tcp://HOST:PORT, or tls://HOST:PORT\n"
    assert (output.out, output.err) == ("", words)


@pytest.mark.parametrize(
    "address", ["tcp://192.0.2.1:8786", "tls://scheduler:8786", "tcp://[2001:db8::1]:8786"]
)
def test_addresses_of_schedulers_are_taken(address: str) -> None:
    worker.check_address(address)


def test_a_worker_that_cannot_start_says_why_and_nothing_else(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(NetworkError, match="the worker cannot start: TLS expects a `ssl_context`"):
        asyncio.run(worker.serve("tls://127.0.0.1:1", "m2", ""))
    output = capfd.readouterr()
    assert output.out + output.err == ""


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "CLUSTER_TIMEOUT_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(NetworkError, match=f"no Dask scheduler answers at {address}: start"):
            asyncio.run(worker.serve(address, "m2", "127.0.0.1"))
