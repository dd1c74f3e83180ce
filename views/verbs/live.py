"""qmn live [RUN]: see what happens in the network that runs, or happened in a run, in the browser.

With --all it shows all networks that start on this machine from now on, as of a class.

The page is served on the loopback, under an address that nobody can guess, until Ctrl-C.
"""

import argparse
import asyncio
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from qmn.needs import Needs
from qmn.options import add_options, read
from qmn.results.titles import TITLES
from qmn.running.network import KILLED, announced_network, dispatcher_of_running_network
from topologies.system.processes.programs import NetworkError
from views.archive.named_run import add_run
from views.live import command_page
from views.live.address import Place, place_given, say, until_a_signal
from views.live.handshakes import drawn_handshake, newest_photons
from views.live.layout import described
from views.live.pages import kept_of_machine
from views.live.server import View, serve
from views.live.sources import following, timeline_of_run
from views.live.timeline import Timeline
from views.report.run_facts import BadRun, read_result
from wire import typed_json
from wire.malformed import MalformedPacket
from wire.parameters.option import option
from wire.results.run_result import NetworkFacts


@dataclass(frozen=True)
class LiveOptions:
    port: int = option(0, "of the page, on the loopback (one that is free)", range=(0, 65535))
    read_only: bool = option(False, "a page to look at: one cannot act")
    for_all: bool = option(False, "also a read-only address for all in the network, by TLS")
    all: bool = option(False, "every network that starts on this machine from now on, one page")
    browser: bool = option(True, "do not open a browser")


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("live", description=__doc__)
    add_run(parser, "default: the network that runs")
    add_options(parser, LiveOptions)
    parser.set_defaults(call=call, needs=_needed)


def _needed(arguments: argparse.Namespace) -> Needs:
    if arguments.all:
        return Needs.ROOT
    return Needs.RUNNING if arguments.run is None else Needs.NOTHING


def call(arguments: argparse.Namespace) -> int:
    """Serve until Ctrl-C; turn what is wrong into one line and an exit status."""
    options = read(LiveOptions, arguments)
    place = place_given() or Place(options.port)
    if options.port not in (0, place.port):
        print("qmn: --port: in Docker it is QMN_LIVE_PORT that chooses it", file=sys.stderr)
        return 2
    try:
        if options.all:
            return _of_machine(arguments.run, options, place)
        with shown(arguments.run, options.read_only) as view:

            def opened(address: str, where: str) -> None:
                say(address, options.browser, where)

            asyncio.run(until_a_signal(serve(view, place, opened, for_all=options.for_all)))
    except (BadRun, MalformedPacket, NetworkError, OSError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    return 0


def _of_machine(run: Path | None, options: LiveOptions, place: Place) -> int:
    """Show all networks until Ctrl-C; raise OSError if another does."""
    if run is not None or options.read_only:
        what = "--all RUN: --all shows networks that start from now on, a run has a page of its own"
        if run is None:
            what = "--all --read-only: add --for-all instead, whose address is read-only"
        print(f"qmn: {what}", file=sys.stderr)
        return 2
    with kept_of_machine() as pages:
        served = command_page.serve(pages, place, for_all=options.for_all, browser=options.browser)
        asyncio.run(until_a_signal(served))
    return 0


@contextmanager
def shown(run: Path | None, read_only: bool) -> Iterator[View]:
    if run is not None:
        result, network = read_result(run)
        timeline = timeline_of_run(run, result.time_scale or 1.0)
        view = _view(run.resolve(), network, timeline, live=False, acts=False)
        if result.error == KILLED:
            view.over = f"{view.over}: {KILLED}"
            print(f"qmn: {KILLED}: the page shows what was there by then", file=sys.stderr)
        yield view
        return
    config = dispatcher_of_running_network()
    running = announced_network()
    folder = Path(running.folder)
    network = typed_json.read(NetworkFacts, running.network)
    timeline = Timeline(running.since_ns)
    with following(timeline, config, folder):
        view = _view(folder, network, timeline, live=True, acts=not read_only)
        view.now_ns = config.time.stamp_ns
        yield view


def _view(folder: Path, network: NetworkFacts, timeline: Timeline, live: bool, acts: bool) -> View:
    return View(
        title_of(folder.name),
        described(network),
        timeline,
        folder,
        live,
        acts,
        {
            "handshake": lambda: drawn_handshake(folder, network),
            "photons": lambda: newest_photons(folder),
        },
    )


def title_of(folder: str) -> str:
    """Return the job of a folder in words, before its name; the name alone if it has none."""
    title = TITLES.get(folder.partition("-")[2])
    return f"{title} ({folder})" if title else folder
