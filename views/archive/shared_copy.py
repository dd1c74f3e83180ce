"""A copy of a run's folder that can be given away: without what its keys could be found by."""

import shutil
from pathlib import Path

from wire.results import schema
from wire.results.run_result import RESULT

# Services that make no keys; in a network of `qmn cli` or a script anybody may have made some.
WITHOUT_KEYS = frozenset({"sdc", "teleport", "distribute", "swap"})
QUBITS = (
    "*.pcap",
    "*.pcapng",
    "*.keys",
    "quantum.*",
    "dispatcher.record",
)  # what shows what qubits were
FILE_MODE, FOLDER_MODE = 0o644, 0o755


class CannotShare(Exception):
    """There is nothing to copy, or nowhere to; the text names the folder and the remedy."""


def share(run: Path, copy: Path) -> list[str]:
    """Copy a run's files; return the names of those that were left out, in order."""
    try:
        head = schema.read_head(run)
    except OSError as error:
        text = "name the folder of a run that has ended, as runs/latest"
        raise CannotShare(f"cannot read {run / RESULT}: {error.strerror}; {text}") from error
    except ValueError as error:
        raise CannotShare(f"{run} has no {RESULT} of a run that has ended: {error}") from error
    secret = () if head.service in WITHOUT_KEYS else QUBITS
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
