"""A live page that is shown to all: read-only, by TLS, under a token of its own."""

import asyncio
import json
import re
import ssl
from hashlib import sha256
from pathlib import Path

import pytest
from live_page import live, served

from views.live import hall
from views.live.hall import Page, asked_of

PAGE = Page(8123, "secret", "token")
ADDRESS = re.compile(r"https://127\.0\.0\.1:(\d+)/([\w-]+)/ .*: ([0-9A-F:]{95})\)")


def head(path: str, *more: str, method: str = "GET") -> bytes:
    return "\r\n".join([f"{method} {path} HTTP/1.1", "Host: any", *more, "", ""]).encode()


@pytest.mark.parametrize(
    ("asked", "path"),
    [
        ("/token/", "/secret/"),
        ("/token/12/", "/secret/12/"),
        ("/token/main.js", "/secret/main.js"),
        ("/token/uplot/uPlot.esm.js", "/secret/uplot/uPlot.esm.js"),
        ("/token/3/network.json", "/secret/3/network.json?look"),
        ("/token/networks?next", "/secret/networks?next"),
        ("/token/messages", "/secret/messages"),
    ],
)
def test_paths_of_the_page_lead_to_it(asked: str, path: str) -> None:
    lines = [f"GET {path} HTTP/1.1", "Host: 127.0.0.1:8123", "Connection: close", "", ""]
    assert asked_of(PAGE, head(asked)) == "\r\n".join(lines).encode()


def test_what_a_viewer_sends_beside_the_path_goes_no_further() -> None:
    sent = ("Last-Event-ID: 17", "Content-Length: 9", "Origin: http://evil", "X: y\tz")
    request = asked_of(PAGE, head("/token/messages", *sent))
    assert request is not None
    assert request.splitlines()[1:] == [
        b"Host: 127.0.0.1:8123",
        b"Connection: close",
        b"Last-Event-ID: 17",
        b"",
    ]


@pytest.mark.parametrize(
    "request_head",
    [
        head("/token/act"),
        head("/token/1/act"),
        head("/token/", method="POST"),
        head("/token/messages", method="POST"),
        head("/tokem/"),
        head("/secret/"),
        head("/token/../secret/act"),
        head("/token/1/../act"),
        head("/token/%61ct"),
        head("/token/network.json?look=1"),
        head("/token/uplot/../act"),
        head("http://127.0.0.1:8123/token/"),
        b"GET /token/ HTTP/1.1 POST /secret/act HTTP/1.1\r\n\r\n",
        b"\x00\xff\r\n\r\n",
    ],
)
def test_all_else_leads_nowhere(request_head: bytes) -> None:
    assert asked_of(PAGE, request_head) is None


def test_a_viewer_reads_the_page_by_tls_and_cannot_act(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hall, "outward_address", lambda: "127.0.0.1")
    with served(live(tmp_path)) as url:
        port, secret = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/(.*)/", url).groups()  # type: ignore[union-attr]

        async def visited() -> None:
            async with hall.hall(int(port), secret) as where:
                found = ADDRESS.fullmatch(where)
                assert found is not None
                there, token, fingerprint = found.groups()
                assert token != secret
                answer = await answered(int(there), head(f"/{token}/network.json"), fingerprint)
                facts = json.loads(answer.partition(b"\r\n\r\n")[2])
                assert facts["acts"] is False
                act = head(f"/{token}/act", "Content-Length: 16", method="POST")
                both = head(f"/{token}/") + act + b'{"act":"policy"}'
                assert b"<title>qmn</title>" in await answered(int(there), both, fingerprint)
                refused = await answered(int(there), act, fingerprint)
                assert refused.startswith(b"HTTP/1.1 404")

        asyncio.run(visited())
    assert not (tmp_path / "acts.jsonl").exists()


async def answered(port: int, request: bytes, fingerprint: str) -> bytes:
    """Return all that is answered, by the server whose certificate has this fingerprint."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
    certificate = writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
    assert sha256(certificate).digest().hex(":").upper() == fingerprint
    writer.write(request)
    answer = await reader.read()
    writer.close()
    return answer
