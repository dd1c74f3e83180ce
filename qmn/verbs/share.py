"""qmn share RUN COPY: a copy of a run's folder that can be given away.

A run's folder can be read by its owner alone. Captures and event logs show what every qubit was: of
a run that may have made keys, the keys come of that, and the copy holds none of it. Everything else
is copied, readable by all. Keys that a run keeps are never in its folder.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from qmn.live.event_sources import RESULT
from wire.metadata import Service

# Services that make no keys; in a network of `qmn cli` or a script anybody may have made some.
WITHOUT_KEYS = {
    service.name.lower()
    for service in (Service.SDC, Service.TELEPORT, Service.DISTRIBUTE, Service.SWAP)
}
QUBITS = ("*.pcap", "*.pcapng", "quantum.*", "dispatcher.record")  # what shows what qubits were
FILE_MODE, FOLDER_MODE = 0o644, 0o755


class CannotShare(Exception):
    """There is nothing to copy, or nowhere to; the text names the folder and the remedy."""


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    text = "copy a run without what is secret in it"
    parser = verbs.add_parser("share", help=text, description=__doc__)
    parser.add_argument("run", type=Path, metavar="RUN", help="its folder, as runs/latest")
    parser.add_argument("copy", type=Path, metavar="COPY", help="a folder that does not exist yet")
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Copy, and say what was left out."""
    try:
        left_out = share(arguments.run, arguments.copy)
    except CannotShare as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 2
    for file in left_out:
        print(f"left out: {file}")
    print(f"copied to {arguments.copy}")
    return 0


def share(run: Path, copy: Path) -> list[str]:
    """Copy a run's files; return the names of those that were left out, in order."""
    try:
        facts = json.loads((run / RESULT).read_text())
    except (OSError, ValueError) as error:
        raise CannotShare(f"{run} has no {RESULT} of a run that has ended: {error}") from error
    without = isinstance(facts, dict) and facts.get("service") in WITHOUT_KEYS
    secret = () if without else QUBITS
    try:
        copy.mkdir(mode=FOLDER_MODE)
    except OSError as error:
        text = f"cannot make {copy}: {error.strerror}; name a folder that does not exist yet"
        raise CannotShare(text) from error
    left_out = []
    for file in sorted(run.iterdir()):
        if file.is_symlink() or not file.is_file() or any(map(file.match, secret)):
            left_out.append(file.name)
            continue
        shutil.copyfile(file, copy / file.name)
        (copy / file.name).chmod(FILE_MODE)
    return left_out
