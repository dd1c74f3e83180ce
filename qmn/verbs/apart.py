"""qmn apart VERB …: another verb in network, processes, /run and Open vSwitch of its own.

So several networks run on one machine at a time. --of PID is a verb in those of `qmn apart` PID.
"""

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from qmn.as_root import COMMAND
from qmn.live_view.beside import page_of_command
from topologies.system.confinement.apart import apart, inside
from topologies.system.processes.programs import NetworkError

FORWARDED = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
LIVE = "--live"  # of the verb
SI_KERNEL = 0x80  # Linux's asm-generic/siginfo.h: a terminal's, which sends Ctrl-C to all by itself


def add_parser(verbs: Any) -> None:
    """Describe the verb."""
    parser = verbs.add_parser(
        "apart",
        help="another verb, beside other networks on this machine",
        description=__doc__,
        usage="qmn apart [--of PID] VERB …",
    )
    parser.add_argument("--of", type=int, metavar="PID", help="of this `qmn apart` that runs")
    parser.add_argument("verb", nargs=argparse.REMAINDER, metavar="VERB …", help="and its options")
    parser.set_defaults(call=call, needs_root=True)


def call(arguments: argparse.Namespace) -> int:
    """Run the verb and return its exit status."""
    if not arguments.verb:
        print("qmn: apart from others, what? As in: qmn apart cli ring", file=sys.stderr)
        return 1
    command = [COMMAND, *arguments.verb]
    if arguments.of is None:
        try:
            # Served out here: the loopback in there is another.
            with page_of_command(LIVE in arguments.verb):
                return beside(command)
        except NetworkError as error:
            print(f"qmn: {error}", file=sys.stderr)
            return 1
    (first,) = inside(arguments.of)[:1] or [0]
    if not first:
        print(f"qmn: process {arguments.of} is not a `qmn apart` that runs", file=sys.stderr)
        return 1
    enter = ["nsenter", f"--target={first}", "--net", "--mount", "--pid"]
    return subprocess.run([*enter, f"--wd={os.getcwd()}", *command], check=False).returncode


def beside(command: Sequence[str]) -> int:
    """Run a command in namespaces of its own; what ends this politely ends that so."""
    with subprocess.Popen(apart(command)) as process:
        awaited = {*FORWARDED, signal.SIGCHLD}
        before = signal.pthread_sigmask(signal.SIG_BLOCK, awaited)
        while process.poll() is None:
            told = signal.sigwaitinfo(awaited)
            if told.si_signo in FORWARDED and told.si_code != SI_KERNEL:
                _forward(told.si_signo)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return process.returncode


def _forward(number: int) -> None:
    """Send a signal to the command in our namespaces."""
    for pid in inside(os.getpid())[1:2]:
        with suppress(ProcessLookupError):  # it has ended
            os.kill(pid, number)
