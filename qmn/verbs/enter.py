"""qmn enter [COMMAND …]: a shell, or any command, inside a network that runs.

As `docker exec`: its switches, interfaces and processes are there, as for
`qmn enter ovs-vsctl show` or `qmn enter tcpdump -i s1-eth1`.
"""

import argparse
import os
import shutil
import subprocess
import sys
from typing import Any

from qmn.needs import Needs, chosen
from topologies.system import namespaces
from topologies.system.processes.programs import ROOT, NetworkError, callers_environment
from topologies.system.runs.runtime import NONE_RUNS


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser(
        "enter",
        description=__doc__,
        usage="qmn enter [--run PID] [COMMAND …]",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--run", type=int, metavar="PID", help="of the `qmn` whose network it is")
    text = "and its words (your shell)"
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="COMMAND …", help=text)
    parser.set_defaults(call=call, needs=Needs.ROOT)


def call(arguments: argparse.Namespace) -> int:
    """Enter, run the command and return its exit status."""
    command = arguments.command or [os.environ.get("SHELL", "/bin/bash")]
    try:
        run = chosen(arguments.run)
        if run is None:
            raise NetworkError(NONE_RUNS)
        status = namespaces.enter(run)
    except NetworkError as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    if status is not None:
        return status
    environment = callers_environment()
    environment["PATH"] = f"{environment.get('PATH', os.defpath)}:{ROOT / 'bin'}"
    if shutil.which(command[0], path=environment["PATH"]) is None:
        print(f"qmn: there is no command {command[0]}", file=sys.stderr)
        return 127
    return subprocess.run(command, env=environment, check=False).returncode
