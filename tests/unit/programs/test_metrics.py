"""The answers to Prometheus, also on a real socket."""

import asyncio
import socket
import urllib.request

import pytest
from limits import SOON_S
from prometheus_client import CollectorRegistry, Counter
from prometheus_client.parser import text_string_to_metric_families

from programs import metrics, metrics_server
from programs.metrics import answer


@pytest.fixture
def registry() -> CollectorRegistry:
    """Return a registry with one metric."""
    registry = CollectorRegistry()
    Counter("photons", "Light.", registry=registry).inc(7)
    return registry


def test_the_metrics_are_told_with_their_length(registry: CollectorRegistry) -> None:
    response = answer(b"GET /metrics HTTP/1.1\r\nHost: a\r\n\r\n", registry)
    head, _, body = response.partition(metrics.END)
    assert head.startswith(b"HTTP/1.1 200 OK\r\n")
    assert f"Content-Length: {len(body)}".encode() in head
    (family,) = text_string_to_metric_families(body.decode())
    assert {sample.name: sample.value for sample in family.samples}["photons_total"] == 7


def test_head_tells_no_metrics(registry: CollectorRegistry) -> None:
    response = answer(b"HEAD /metrics HTTP/1.1\r\n\r\n", registry)
    assert response.startswith(b"HTTP/1.1 200 OK\r\n")
    assert response.endswith(b"\r\n\r\n")


@pytest.mark.parametrize(
    ("head", "status"),
    [
        (b"POST /metrics HTTP/1.1\r\n\r\n", b"405"),
        (b"GET / HTTP/1.1\r\n\r\n", b"404"),
        (b"GET /metrics/../x HTTP/1.1\r\n\r\n", b"404"),
        (b"GET /metrics HTTP/1.1\r\n", b"400"),
        (b"GET /metrics\r\n\r\n", b"400"),
        (b"\x16\x03\x01\x02\r\n\r\n", b"400"),
        (b"", b"400"),
    ],
)
def test_what_is_no_question_gets_a_status(
    registry: CollectorRegistry, head: bytes, status: bytes
) -> None:
    assert answer(head, registry).split(b" ")[1] == status


def test_a_server_answers_on_the_socket_that_it_is_handed(
    registry: CollectorRegistry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(metrics_server, "METRICS_TIMEOUT_S", 0.2)

    async def run() -> None:
        with socket.create_server(("127.0.0.1", 0)) as opened:
            address = "{}:{}".format(*opened.getsockname())
            listener = metrics.inherited(opened.detach())
        server = metrics_server.serve(listener, registry)
        silent, first = await asyncio.open_connection(*address.split(":"))
        long, second = await asyncio.open_connection(*address.split(":"))
        second.write(bytes(metrics.MAX_HEAD_BYTES + 64))
        url = f"http://{address}/metrics"
        text = await asyncio.to_thread(lambda: urllib.request.urlopen(url, timeout=SOON_S).read())
        assert b"photons_total 7.0" in text
        assert (await long.read()).startswith(b"HTTP/1.1 400")
        assert await silent.read() == b""  # its time was over
        for client in (first, second):
            client.close()
            await client.wait_closed()
        server.close()

    asyncio.run(asyncio.wait_for(run(), 20))
