"""The one address of several networks, of a command or of a machine: it leads to each's page.

    python -m views.live.command_page FOLDER     of pages.py

GET /SECRET/            goes to the newest network that runs; if none does, says so
GET /SECRET/next.js     by which that page goes to the next one
GET /SECRET/networks    the networks: names by number, which run, whether no more will come;
                        with ?next as soon as one runs, or none will come
    /SECRET/NUMBER/...  whatever the server of that network answers

It runs until a signal ends it, and takes the folder away.
"""

import asyncio
import json
import re
import shutil
import sys
from contextlib import suppress
from functools import partial
from html import escape
from pathlib import Path

from programs.connection_shares import StreamServer
from programs.relay import relay
from qmn.timeouts import LIVE_HEAD_S, LIVE_LAST_S, LIVE_LOOK_AGAIN_S
from views.live.address import LOOPBACK, Place, listen, place_given, say, until_a_signal
from views.live.hall import FOR_ALL, shown_to_all
from views.live.pages import PORT, Pages

HTML, JSON = "text/html; charset=utf-8", "application/json"
HEADERS = "Cache-Control: no-store\r\nReferrer-Policy: no-referrer\r\nConnection: close\r\n"
HEADERS += "Content-Security-Policy: default-src 'none'; script-src 'self'; connect-src 'self'\r\n"
HEADERS += "X-Content-Type-Options: nosniff\r\n"
WAITING = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>qmn</title>
<meta name="color-scheme" content="light dark">
<script type="module" src="%snext.js"></script>
<h1>qmn</h1><p role="status">%s This page goes to the next network by itself.</p></html>"""
SCRIPT = Path(__file__).with_name("page") / "next.js"
NONE_YET = "No network runs yet."
ENDED = "Network {}, {}, has ended."


async def serve(pages: Pages, place: Place, *, for_all: bool, browser: bool = True) -> None:
    """Say where it is, and serve until cancelled; raise OSError if the place cannot be had."""
    over, waiting = asyncio.Event(), set[asyncio.Task[None]]()
    answer = partial(answered, pages, over, waiting)
    listener, port = listen(place)
    async with shown_to_all(for_all, place, port, pages.secret) as where:
        server = StreamServer(answer, listener)
        (pages.folder / PORT).write_text(str(port))
        try:
            say(f"http://{LOOPBACK}:{port}/{pages.secret}/", browser, for_all=where)
            await asyncio.Event().wait()
        finally:
            over.set()
            if waiting:  # who wait for a network hear that none comes
                await asyncio.wait(waiting, timeout=LIVE_LAST_S)
            server.close()
            shutil.rmtree(pages.folder)


async def answered(
    pages: Pages,
    over: asyncio.Event,
    waiting: "set[asyncio.Task[None]]",
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
) -> None:
    """Answer one request, or have the network answer that it is about; each has a connection."""
    try:
        async with asyncio.timeout(LIVE_HEAD_S):
            head = await reader.readuntil(b"\r\n\r\n")
    except (asyncio.IncompleteReadError, asyncio.LimitOverrunError, ConnectionError, TimeoutError):
        writer.close()
        return
    match = re.match(
        rb"[A-Z]+ /" + pages.secret.encode() + rb"/(?:(\d{1,9})/)?([^ ?]*)(\?next)?", head
    )
    number = int(match[1] or 0) if match else 0
    if number and pages.runs(number):
        connect = partial(asyncio.open_unix_connection, pages.socket(number))
        await relay(connect, (reader, writer), head)
        return
    path = match[2].decode(errors="replace") if match else ""
    task = asyncio.current_task()
    assert task is not None
    waiting.add(task)
    try:
        if match and match[3]:
            await next_network(pages, over)
        writer.write(answer_to(pages, number, path, over.is_set()) if match else response(404))
        with suppress(ConnectionError):
            await writer.drain()
        writer.close()
    finally:
        waiting.discard(task)


async def next_network(pages: Pages, over: asyncio.Event) -> None:
    """Wait until a network runs, or none will."""
    while not over.is_set() and not any(map(pages.runs, pages.names())):
        with suppress(TimeoutError):
            await asyncio.wait_for(over.wait(), LIVE_LOOK_AGAIN_S)


def answer_to(pages: Pages, number: int, path: str, over: bool) -> bytes:
    """Return the answer to a request that no network can answer; `over`: none will begin."""
    names, up = pages.names(), "../" if number else ""  # without the secret: others see it, too
    running = [name for name in names if pages.runs(name)]
    if path == "networks" and not number:
        return response(200, JSON, json.dumps({"names": names, "running": running, "over": over}))
    if path == SCRIPT.name and not number:
        return response(200, "text/javascript", SCRIPT.read_text())
    if path:
        return response(404)
    if running:
        return response(302, more=f"Location: {up}{running[-1]}/\r\n")
    last = max(names, default=0)
    sentence = ENDED.format(last, escape(names[last])) if last else NONE_YET
    return response(200, HTML, WAITING % (up, sentence))


def response(status: int, kind: str = "text/plain", text: str = "", more: str = "") -> bytes:
    body = text.encode()
    head = f"HTTP/1.1 {status} -\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
    return f"{head}{HEADERS}{more}\r\n".encode() + body


if __name__ == "__main__":
    try:
        pages, place = Pages(Path(sys.argv[1])), place_given() or Place()
        asyncio.run(until_a_signal(serve(pages, place, for_all=FOR_ALL in sys.argv[2:])))
    except OSError as error:
        sys.exit(f"qmn: {error}")
