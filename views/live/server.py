"""The server of a live view: one page on the loopback, under a path that is a secret.

GET  /SECRET/                 the page, and its modules beside it
GET  /SECRET/network.json     nodes with places, fibres, copper
GET  /SECRET/messages?after=N server-sent events: lists of messages (timeline.py)
GET  /SECRET/handshake        the newest handshake as the report draws it
GET  /SECRET/photons          the first photons of the newest key session, likewise
POST /SECRET/act              one of acts.py, as JSON
"""

import asyncio
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tornado.httpserver import HTTPServer
from tornado.iostream import StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler

from qmn.timeouts import LIVE_DRAWN_S, LIVE_LAST_S, LIVE_LIST_S, LIVE_NEWEST_S
from views.live.acts import BadAct, command_for, perform
from views.live.address import LOOPBACK, Place, listen
from views.live.hall import shown_to_all
from views.live.pace import Pace
from views.live.sources import ACT
from views.live.timeline import Timeline
from wire.bounded_json import decode_json
from wire.malformed import MalformedPacket

PAGE, INDEX = Path(__file__).with_name("page"), "index.html"
STYLE = Path(__file__).parents[1] / "report" / "report.css"
AT_ONCE = 2000  # messages in one list
MOST_REQUEST = 1 << 16  # bytes
MOST_DEPTH = 2  # of objects in a request
POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; "
POLICY += "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"


@dataclass
class View:
    """A timeline to show, and the acts that are allowed."""

    name: str
    network: dict[str, Any]  # layout.described
    timeline: Timeline
    folder: Path  # of the run
    live: bool  # whether it goes on, or is over
    acts: bool  # whether one may act
    drawings: Mapping[str, Callable[[], str]]  # elements of the page by the last part of the path
    pace: Pace = field(default_factory=Pace)
    over: str = "a run that is over"  # of one that does not go on
    opening_s: float = -math.inf  # when a page was asked for that has not asked for messages yet
    now_ns: Callable[[], int] = time.time_ns  # as events are stamped
    streams: set["asyncio.Task[Any]"] = field(default_factory=set)  # of messages, being sent
    _drawing: asyncio.Lock = field(default_factory=asyncio.Lock)
    _drawn: dict[str, tuple[float, str]] = field(default_factory=dict)  # and when

    async def drawn(self, name: str) -> str:
        """Return a drawing: many viewers have it drawn once."""
        async with self._drawing:
            if time.monotonic() - self._drawn.get(name, (-math.inf,))[0] > LIVE_DRAWN_S:
                made = await asyncio.to_thread(self.drawings[name])
                self._drawn[name] = time.monotonic(), made
        return self._drawn[name][1]


async def serve(
    view: View, place: Place, opened: Callable[[str, str], None], *, for_all: bool = False
) -> None:
    """Serve until this task is cancelled; `opened` gets the address once it can be asked.

    It also gets that of all, "" if the page is not shown to all.

    Raise OSError if the place cannot be had.
    """
    path = place.path()
    listener, port = listen(place)
    application = Application(pages(view, place, path), log_function=lambda _handler: None)
    # The address of several pages, if it leads here, looks at the first request of a connection.
    alone = place.number == 0
    server = HTTPServer(application, max_body_size=MOST_REQUEST, no_keep_alive=not alone)
    server.add_socket(listener)
    try:
        async with shown_to_all(for_all, place, port, path) as where:
            opened(f"http://{LOOPBACK}:{port}/{path}/", where)
            await asyncio.Event().wait()
    finally:
        if not view.timeline.ended:
            await asyncio.sleep(LIVE_NEWEST_S)
        view.timeline.end()
        await until_opened(view)
        server.stop()
        if view.streams:  # that tell their readers so
            await asyncio.wait(view.streams, timeout=LIVE_LAST_S)
        await server.close_all_connections()


def pages(view: View, place: Place, path: str) -> list[tuple[str, "type[Guarded]", dict[str, Any]]]:
    """Return what is at each address, with the arguments of its handler."""
    viewed = {"view": view}
    return [
        (rf"/{path}/network.json", Network, {**viewed, "number": place.number}),
        (rf"/{path}/messages", Messages, viewed),
        (rf"/{path}/({'|'.join(view.drawings)})", Drawing, viewed),
        (rf"/{path}/act", Act, viewed),
        (rf"/{path}/()", Index, {**viewed, "path": str(PAGE), "default_filename": INDEX}),
        (rf"/{path}/(report\.css)", File, {"path": str(STYLE.parent)}),
        (rf"/{path}/(.*)", File, {"path": str(PAGE)}),
    ]


async def until_opened(view: View) -> None:
    """Keep serving until an opening page has loaded, even if the run has ended."""
    end_s = min(view.opening_s, time.monotonic()) + LIVE_LAST_S  # who asks later is too late
    while view.opening_s > -math.inf and time.monotonic() < end_s:
        await asyncio.sleep(LIVE_LIST_S)


class Guarded(RequestHandler):
    """Answers pages of this server alone: a name that leads here from elsewhere is refused."""

    def prepare(self) -> None:
        """Refuse a foreign name in Host, or a foreign page in Origin."""
        host = self.request.host.partition(":")[0]
        if host not in (LOOPBACK, "localhost"):
            raise HTTPError(403, reason="this page is served on the loopback alone")
        origin = self.request.headers.get("Origin")
        if origin is not None and origin != f"http://{self.request.host}":
            raise HTTPError(403, reason="asked by another page")

    def set_default_headers(self) -> None:
        self.set_header("Content-Security-Policy", POLICY)
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")


class File(Guarded, StaticFileHandler):
    def set_extra_headers(self, _path: str) -> None:
        self.set_header("Cache-Control", "no-store")


class Index(File):
    def initialize(self, view: View, path: str, default_filename: str) -> None:  # type: ignore[override]
        super().initialize(path, default_filename)
        self.view = view

    def prepare(self) -> None:
        super().prepare()
        self.view.opening_s = time.monotonic()


class Answer(Guarded):
    def initialize(self, view: View) -> None:
        self.view = view


class Network(Answer):
    def initialize(self, view: View, number: int) -> None:  # type: ignore[override]
        """Know the view, and the number of the network in its command; 0: it is the only one."""
        super().initialize(view)
        self.number = number

    def get(self) -> None:
        view = self.view
        self.write(
            {
                "name": view.name,
                "number": self.number,
                "live": view.live,
                "over": view.over,
                "acts": view.acts and self.get_argument("look", None) is None,
                "origin_ns": str(view.timeline.origin_ns),
                **view.network,
            }
        )


class Drawing(Answer):
    async def get(self, name: str) -> None:
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.write(await self.view.drawn(name))


class Messages(Answer):
    async def get(self) -> None:
        """Send lists of messages until there are no more, or nobody reads."""
        timeline = self.view.timeline
        try:
            position = int(
                self.request.headers.get("Last-Event-ID", self.get_argument("after", "0"))
            )
        except ValueError as error:
            raise HTTPError(400, reason="after is a number") from error
        self.set_header("Content-Type", "text/event-stream")
        task = asyncio.current_task()
        assert task is not None
        self.view.streams.add(task)
        more, loop = asyncio.Event(), asyncio.get_running_loop()
        try:
            with timeline.telling(lambda: loop.call_soon_threadsafe(more.set)):
                await self._send_all(position, more)
        except StreamClosedError:
            pass  # nobody reads any more
        finally:
            self.view.streams.discard(task)

    async def _send_all(self, position: int, more: asyncio.Event) -> None:
        """Send what comes, list by list; `more` is set whenever something has come."""
        timeline, told_s = self.view.timeline, 0.0
        self.view.opening_s = -math.inf
        await self.flush()  # it is connected, though nothing may happen for long
        while True:
            more.clear()
            over = timeline.ended
            messages, position, missed = timeline.after(position, AT_ONCE)
            if missed:
                self._write("missed", position, str(missed))
            if messages:
                self._write("messages", position, f"[{','.join(messages)}]")
            elif over:
                self._write("ended", position, "null")
                await self.flush()
                return
            pause_s = self.view.pace.look() if self.view.live else 0.0
            if pause_s != told_s:
                self._write("pause", position, str(round(1000 * pause_s)))
                told_s = pause_s
            await self.flush()
            if not over and len(messages) < AT_ONCE:
                await asyncio.sleep(pause_s)
                await more.wait()

    def _write(self, event: str, position: int, data: str) -> None:
        self.write(f"event: {event}\nid: {position}\ndata: {data}\n\n")


class Act(Answer):
    async def post(self) -> None:
        """Perform it; answer with the command and its output."""
        view = self.view
        if not view.acts:
            raise HTTPError(403, reason="this page is read-only")
        if self.request.headers.get("Content-Type", "").partition(";")[0] != "application/json":
            raise HTTPError(415, reason="an act is application/json")
        try:
            command = command_for(decode_json(self.request.body, MOST_REQUEST, MOST_DEPTH))
        except (BadAct, MalformedPacket) as error:
            self.set_status(400)
            self.write({"output": str(error), "status": 2})
            return
        time_ns, done = await perform(command, view.folder, view.now_ns)
        view.timeline.add(ACT, time_ns, done)
        self.write(done)
