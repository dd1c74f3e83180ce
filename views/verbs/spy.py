"""qmn spy [RUN]: what happens to the qubits, one line an event: now, or in a run that was."""

import argparse
import json
import os
import re
import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hosts.quantum_socket import STACK_VARIABLE
from qmn.needs import Needs
from qmn.options import read
from qmn.running.network import dispatcher_of_running_network
from topologies.system.processes.programs import NetworkError
from topologies.system.runs.runtime import EVENT_CAPTURE
from views.archive.named_run import add_run
from views.events.event_sources import attached, recorded, single, through_stack
from views.events.unread_events import dropped
from wire.dispatcher_pb2 import Event, WatchRequest
from wire.events import DROPPED, format_line, to_json
from wire.malformed import MalformedPacket
from wire.parameters.checks import remedy


@dataclass(frozen=True)
class SpyOptions:
    run: Path | None = None  # a folder, or a file of events; None: what happens now
    node: tuple[str, ...] = ()  # none: all
    session: tuple[int, ...] = ()
    kind: tuple[str, ...] = ()
    follow: bool | None = None
    history: bool = False
    per_qubit: bool = False
    json: bool = False


class BadFilter(Exception):
    """The filter is invalid; the text names value and remedy."""


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("spy", description=__doc__)
    add_run(parser, "default: what happens now; on a host, there")
    add = parser.add_argument
    add("--node", action="append", metavar="NAME", help="only this node (more than once)")
    add(
        "--session",
        action="append",
        type=session_number,
        metavar="HEX",
        help="only this session, as the lines show it (more than once)",
    )
    add("--kind", action="append", metavar="KIND", help="only events such as send (or more)")
    add(
        "--follow",
        action=argparse.BooleanOptionalAction,
        help="go on with what happens next (default for the network that runs)",
    )
    add("--history", action="store_true", help="begin with what the dispatcher still remembers")
    add("--per-qubit", action="store_true", help="also what became of single photons")
    add("--json", action="store_true", help="one JSON object a line, for programs")
    parser.set_defaults(call=call, needs=_needed)


def _needed(arguments: argparse.Namespace) -> Needs:
    """On a host of a network, which has a stack, that network is the one."""
    of_host = STACK_VARIABLE in os.environ
    return Needs.RUNNING if arguments.run is None and not of_host else Needs.NOTHING


def session_number(text: str) -> int:
    """Return the session that is meant; raise ArgumentTypeError for anything else."""
    if not re.fullmatch(r"(0x)?[0-9a-fA-F]{1,16}", text):
        raise argparse.ArgumentTypeError(f"{text!r} is not 1 to 16 hexadecimal digits")
    return int(text, 16)


def call(arguments: argparse.Namespace) -> int:
    """Print events; turn what is wrong into one line and an exit status."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    options = read(SpyOptions, arguments)
    spy = Spy(options)
    try:
        spy.print_all(events(options))
    except KeyboardInterrupt:
        pass  # the way to end it
    except (BadFilter, MalformedPacket, NetworkError, OSError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    print(spy.summary(), file=sys.stderr)
    return 0


def events(options: SpyOptions) -> Iterator[Event]:
    """Return where events come from; raise for a source that there is not."""
    if options.run is not None:
        if options.history:
            raise BadFilter("--history is of the network that runs; a run is shown from its start")
        return recorded(find_record(options.run), follow=bool(options.follow))
    stack = os.environ.get(STACK_VARIABLE)
    if stack:
        return of_this_node(options, stack)
    config = dispatcher_of_running_network()
    nodes = {*config.tokens, *(switch.name for switch in config.switches)}
    for node in options.node:
        if node not in nodes:
            raise BadFilter(f"unknown node {node!r}: {remedy(node, sorted(nodes))}")
    if options.follow is False:
        if not config.event_capture:
            raise BadFilter(
                "--no-follow: this network writes no events (--without events); follow it"
            )
        return recorded(find_record(Path(config.event_capture)), follow=False)
    return attached(config, watch_request(options))


def watch_request(options: SpyOptions) -> WatchRequest:
    """Return what to ask the dispatcher for: several nodes or sessions are chosen from here."""
    return WatchRequest(
        node=single(options.node, ""),
        session=single(options.session, 0),
        history=options.history,
        per_qubit=options.per_qubit,
    )


def of_this_node(options: SpyOptions, stack: str) -> Iterator[Event]:
    """Return what happens at the host that the verb is called on."""
    node = Path(stack).stem
    follow = options.follow is not False
    if not follow and not options.history:
        raise BadFilter(f"--no-follow on {node}: add --history, or there is nothing to show")
    for name in options.node:
        if name != node:
            raise BadFilter(
                f"--node {name}: a host shows only its own events, here those of {node}"
            )
    return through_stack(stack, single(options.session, 0), options.history, follow)


def find_record(run: Path) -> Path:
    """Return the file of a run's events; raise BadFilter if it has none."""
    file = run / EVENT_CAPTURE if run.is_dir() else run
    if not file.is_file():
        raise BadFilter(
            f"no quantum events at {file}: name the folder of a run that has them, as all have but "
            "those made --without events"
        )
    return file


class Spy:
    def __init__(self, options: SpyOptions) -> None:
        self._nodes, self._sessions = frozenset(options.node), frozenset(options.session)
        self._kinds = frozenset(options.kind)
        self._as_json, self._per_qubit = options.json, options.per_qubit
        self._count = self._dropped = 0

    def print_all(self, source: Iterator[Event]) -> None:
        """Print every event that is wanted, each at once."""
        for event in source:
            if self.wants(event):
                text = json.dumps(to_json(event)) if self._as_json else format_line(event)
                self._note(event)
                print(text, flush=True)

    def wants(self, event: Event) -> bool:
        """Return whether to show an event; that some were dropped is always shown."""
        return event.kind == DROPPED or (
            (self._per_qubit or not event.photon)
            and (not self._nodes or event.node in self._nodes)
            and (not self._sessions or event.block.session in self._sessions)
            and (not self._kinds or event.kind in self._kinds)
        )

    def _note(self, event: Event) -> None:
        if event.kind == DROPPED:
            self._dropped += dropped(event)
        else:
            self._count += 1

    def summary(self) -> str:
        return f"qmn: {self._count:,} events shown, {self._dropped:,} dropped"
