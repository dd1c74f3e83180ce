"""A read-only address of a live page for a whole network, as in a lecture hall.

    https://ADDRESS:PORT/TOKEN/PATH  -->  http://127.0.0.1:PORT/SECRET/PATH

Only paths of the page pass, and each is asked for by a request that is written here: that of acts
is none of them, and nothing else that a viewer sends reaches the page.
"""

import asyncio
import re
import secrets
import socket
import ssl
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from hmac import compare_digest
from pathlib import Path
from tempfile import TemporaryDirectory

from programs.connection_shares import StreamServer
from programs.relay import CHUNK_BYTES
from qmn.timeouts import LIVE_HALL_S
from topologies.system.certificates import CertificateAuthority
from topologies.system.namespaces import in_machine_network, machine_listener
from views.live.address import LOOPBACK, Place

FOR_ALL = "for-all"  # of a command page: it is shown so
ALL = "0.0.0.0"  # noqa: S104 (a lecture hall is meant)
ELSEWHERE = ("192.0.2.1", 9)  # RFC 5737: nobody; which address of ours would lead there is asked
PATHS = rb"|[a-z]+\.(?:js|css)|uplot/\w+(?:\.\w+)+|network\.json|messages|handshake|photons"
PATHS += rb"|networks(?:\?next)?"
ASKED = re.compile(rb"GET /([\w-]{1,64})/((?:\d{1,9}/)?(?:" + PATHS + rb")) HTTP/1\.1\r\n")
LAST = re.compile(rb"\r\nLast-Event-ID: (\d{1,15})\r\n", re.IGNORECASE)
LOOK = b"?look"  # at the facts of a network: without acts
NONE = b"HTTP/1.1 404 -\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


@dataclass(frozen=True)
class Page:
    """The page on the loopback that is shown."""

    port: int
    secret: str
    token: str  # of the address for all


@asynccontextmanager
async def hall(port: int, secret: str) -> AsyncIterator[str]:
    """Serve the page for all while this lasts; yield where, in words. Raise OSError."""
    address = in_machine_network(outward_address)
    page = Page(port, secret, secrets.token_urlsafe(16))
    listener = machine_listener(ALL, 0)
    with TemporaryDirectory(prefix="qmn-live-") as folder:
        context, fingerprint = identity(Path(folder) / "tls", address)
    url = f"https://{address}:{listener.getsockname()[1]}/{page.token}/"
    server = StreamServer(partial(answered, page), listener, ssl=context)
    try:
        yield f"{url} (read-only; SHA-256 of its certificate: {fingerprint})"
    finally:
        server.close()


def shown_to_all(
    for_all: bool, place: Place, port: int, secret: str
) -> AbstractAsyncContextManager[str]:
    """Return the address for all, if it is wanted; "" if not. Raise OSError where none can be."""
    if not for_all:
        return nullcontext("")
    if place.socket is not None:
        raise OSError("a container has no network: show a page to all without Docker")
    return hall(port, secret)


def outward_address() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        try:
            asking.connect(ELSEWHERE)
        except OSError as error:
            raise OSError(f"this machine has no address on a network: {error.strerror}") from error
        return str(asking.getsockname()[0])


def identity(folder: Path, address: str) -> tuple[ssl.SSLContext, str]:
    """Return a server's side of TLS with a certificate for this address, and its fingerprint."""
    authority = CertificateAuthority(folder, "qmn live")
    files = authority.issue("live", {socket.gethostname(): address})
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.load_cert_chain(files.certificate, files.private_key)
    der = ssl.PEM_cert_to_DER_cert(files.certificate.read_text())
    return context, sha256(der).digest().hex(":").upper()


async def answered(page: Page, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Answer one request of a viewer by what the page answers; each has a connection."""
    try:
        async with asyncio.timeout(LIVE_HALL_S):
            head = await reader.readuntil(b"\r\n\r\n")
        request = asked_of(page, head)
        if request is None:
            writer.write(NONE)
            await writer.drain()
        else:
            await _pass_on(page, request, writer)
    except (asyncio.IncompleteReadError, asyncio.LimitOverrunError, OSError, TimeoutError):
        pass  # the viewer has gone, or the page has
    finally:
        writer.close()


def asked_of(page: Page, head: bytes) -> bytes | None:
    """Return the request to the page that a viewer's leads to; None if it leads to none."""
    match = ASKED.match(head)
    if match is None or not compare_digest(match[1], page.token.encode()):
        return None
    path, last = match[2], LAST.search(head)
    look = LOOK if path.endswith(b"network.json") else b""
    since = b"Last-Event-ID: " + last[1] + b"\r\n" if last else b""
    place = b"GET /" + page.secret.encode() + b"/" + path + look + b" HTTP/1.1\r\n"
    host = f"Host: {LOOPBACK}:{page.port}\r\nConnection: close\r\n".encode()
    return place + host + since + b"\r\n"


async def _pass_on(page: Page, request: bytes, writer: asyncio.StreamWriter) -> None:
    far_reader, far_writer = await asyncio.open_connection(LOOPBACK, page.port)
    try:
        far_writer.write(request)
        while data := await far_reader.read(CHUNK_BYTES):
            writer.write(data)
            await writer.drain()
    finally:
        far_writer.close()
