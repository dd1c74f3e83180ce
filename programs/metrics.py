"""Metrics for Prometheus: what a program answers when it is asked for them over HTTP.

The runner opens the socket, in its own network namespace, and hands it over: so Prometheus on
this machine reaches also a program that runs inside a host of the emulated network.
"""

import socket

from prometheus_client import (
    CONTENT_TYPE_LATEST,
    CollectorRegistry,
    disable_created_metrics,
    generate_latest,
)

PATH = "/metrics"
MAX_HEAD_BYTES = 8192  # of a request
END = b"\r\n\r\n"
# A light path takes milliseconds, a call of the dispatcher some hundred microseconds.
SECONDS = tuple(digit * 10.0**power for power in range(-5, 1) for digit in (1, 2, 5))
PLAIN = "text/plain; charset=utf-8"

disable_created_metrics()  # type: ignore[no-untyped-call]  # programs live as long as their run


def answer(head: bytes, registry: CollectorRegistry) -> bytes:
    """Return the response to a request's head: the metrics, or what is wrong with it."""
    parts = head.partition(b"\r\n")[0].split(b" ")
    if len(parts) != 3 or not parts[2].startswith(b"HTTP/1.") or not head.endswith(END):
        return _response("400 Bad Request", PLAIN, b"this is not HTTP/1\n")
    method, target, _version = parts
    if method not in (b"GET", b"HEAD"):
        return _response("405 Method Not Allowed", PLAIN, b"use GET\n", "Allow: GET, HEAD\r\n")
    if target.partition(b"?")[0] != PATH.encode():
        return _response("404 Not Found", PLAIN, f"the metrics are at {PATH}\n".encode())
    response = _response("200 OK", CONTENT_TYPE_LATEST, generate_latest(registry))
    return response if method == b"GET" else response.partition(END)[0] + END


def unavailable(problem: str) -> bytes:
    return _response("503 Service Unavailable", PLAIN, f"{problem}\n".encode())


def _response(status: str, content_type: str, body: bytes, further: str = "") -> bytes:
    head = f"HTTP/1.1 {status}\r\nContent-Type: {content_type}\r\n{further}"
    head += f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    return head.encode() + body


def inherited(descriptor: int) -> socket.socket:
    listener = socket.socket(fileno=descriptor)
    listener.set_inheritable(False)
    return listener
