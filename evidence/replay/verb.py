"""qmn replay RUN: do again what the dispatcher did in a run, and compare the event logs.

The record in the run's folder says what the dispatcher was asked, in which order, and the times
of its clock. The same seed must then give the same events, byte for byte.

A record can name the file of a noise model of somebody's own, which a replay loads and runs: that
takes --allow-code.
"""

import argparse
import sys
from pathlib import Path
from typing import Any, TextIO, cast

from evidence.replay.replay import NamesCode, replay
from views.archive.named_run import add_run
from wire.dispatcher_record import BadRecord, has_ended

RECORD = "dispatcher.record"
EVENTS = "quantum.log"


class BadRun(Exception):
    """A run that cannot be replayed; the text names file and remedy."""


class Comparison:
    """A log that is compared, line by line, with one that was written before."""

    def __init__(self, recorded: TextIO) -> None:
        self._recorded = recorded
        self.lines = 0
        self.difference = ""

    def write(self, text: str) -> int:
        for line in text.splitlines(keepends=True):
            self._compare(self._recorded.readline(), line)
        return len(text)

    def flush(self) -> None:
        """Do nothing: nothing is held back."""

    def end(self) -> None:
        if rest := self._recorded.readline():
            self._compare(rest, "")

    def _compare(self, recorded: str, replayed: str) -> None:
        self.lines += 1
        if recorded != replayed and not self.difference:
            lines = [line.rstrip("\n") or "(no line)" for line in (recorded, replayed)]
            self.difference = f"line {self.lines}\n  recorded: {lines[0]}\n  replayed: {lines[1]}"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("replay", description=__doc__)
    add_run(parser)
    text = "run the noise models of one's own that the record names, from their files"
    parser.add_argument("--allow-code", action="store_true", help=text)
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Replay and compare; turn what is wrong into one line and an exit status."""
    try:
        comparison, requests = compare(arguments.run, arguments.allow_code)
    except BadRun as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 2
    if comparison.difference:
        print(f"different from {comparison.difference}")
        return 1
    print(f"identical: {comparison.lines:,} events of {requests:,} requests")
    if has_ended(arguments.run / RECORD):
        print("the record ends there, as it has become too long (--file-gib)")
    return 0


def compare(run: Path, allow_code: bool = False) -> tuple[Comparison, int]:
    """Replay a run; return the comparison of its events and how many requests there were."""
    try:
        with (run / RECORD).open("rb") as record, (run / EVENTS).open(newline="") as events:
            comparison = Comparison(events)
            requests = replay(record, cast(TextIO, comparison), allow_code)
            if not has_ended(run / RECORD):
                comparison.end()
    except OSError as error:
        raise BadRun(
            f"cannot read {error.filename}: {error.strerror}; name the folder of a run "
            "that has its record, as all have but those made --without record"
        ) from error
    except NamesCode as error:
        raise BadRun(
            f"{run / RECORD} is not replayed: {error}; read it, and if you would run it, replay "
            "with --allow-code"
        ) from error
    except (BadRecord, UnicodeDecodeError) as error:
        raise BadRun(f"{run / RECORD} cannot be replayed: {error}") from error
    return comparison, requests
