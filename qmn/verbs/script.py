"""qmn script FILE: run a Python script of yours, as root, with our packages: docs/scripting.md."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from qmn.needs import Needs
from qmn.options import add_options
from qmn.requests.run_options import LiveOptions
from topologies.system.processes.programs import ENVIRONMENT, NetworkError, callers_environment
from views.live.beside import begin_page_of_command
from views.live.pages import Pages

MODULE = "qmn.scripting.script"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("script", description=__doc__)
    add_options(parser, LiveOptions)
    parser.add_argument("file", type=Path, metavar="FILE", help="the script")
    parser.add_argument("words", nargs=argparse.REMAINDER, metavar="…", help="its own arguments")
    parser.set_defaults(call=call, needs=Needs.NETWORK)


def call(arguments: argparse.Namespace) -> int:
    if arguments.file.is_file():
        try:
            # The server ends with this program, which the script replaces.
            for_all = arguments.live_for_all
            if (arguments.live or for_all) and not Pages.of_command():
                begin_page_of_command(for_all=for_all)
        except NetworkError as error:
            print(f"qmn: {error}", file=sys.stderr)
            return 1
        become(arguments.file, arguments.words)
    print(f"qmn: there is no script {arguments.file}", file=sys.stderr)
    return 1


def become(file: Path, words: Sequence[str]) -> NoReturn:
    environment = {**callers_environment(), "PYTHONPATH": ENVIRONMENT["PYTHONPATH"]}
    # -P: modules in the user's folder are found only if it has the script, too.
    command = [sys.executable, "-P", "-m", MODULE, str(file), *words]
    os.execve(sys.executable, command, environment)  # noqa: S606
