"""qmn rootless VERB …: another verb as root of a user namespace, without root of this machine.

While commands of a user run so, further ones are in the same namespace, so that `qmn rootless
enter` and `qmn rootless set` find their networks. It has the ids of /etc/subuid beside the user's.
"""

import argparse
import os
import shutil
import sys
from contextlib import suppress
from typing import Any

from qmn.needs import COMMAND
from topologies.system.processes.owners import PROC

MARK = "run/qmn/rootless"
# /run is the namespace's own, but for what belongs to sessions of users: browsers need it.
PREPARE = f"""
set -e
exec 3</run
mount -t tmpfs -o mode=755 tmpfs /run
mkdir /run/qmn /run/user
touch /{MARK}
[ ! -d /proc/self/fd/3/user ] || mount --no-canonicalize --rbind /proc/self/fd/3/user /run/user
exec 3<&-
exec "$@"
"""
MAKE = ("unshare", "--map-auto", "--map-root-user", "--mount", "sh", "-c", PREPARE, "sh")


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "rootless",
        description=__doc__,
        usage="qmn rootless VERB …",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    text = "and its words"
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="VERB …", help=text)
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Go on as this verb in the user's namespace; return 1 where there can be none."""
    if os.geteuid() == 0:
        return refused("you are root: leave out `rootless`")
    if shutil.which("newuidmap") is None:
        return refused("newuidmap is missing: install the Debian package uidmap")
    there = process_there()
    enter = ("nsenter", "--target", there, "--user", "--mount", f"--wd={os.getcwd()}")
    command = [*(enter if there else MAKE), COMMAND, *arguments.words]
    return os.execvp(command[0], command)  # noqa: S606


def refused(text: str) -> int:
    print(f"qmn: {text}", file=sys.stderr)
    return 1


def process_there() -> str:
    """Return the id of a process in this user's namespace; "" if there is none."""
    for folder in PROC.glob("[0-9]*"):
        with suppress(OSError):  # another user's, or it has just ended
            if folder.stat().st_uid == os.getuid() and (folder / "root" / MARK).exists():
                return folder.name
    return ""
