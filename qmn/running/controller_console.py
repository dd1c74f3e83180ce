"""Asks the controller of the network that runs on this machine, over its console."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console

from topologies.system.runs.console import answer_of
from topologies.system.runs.runtime import CONSOLE, NONE_RUNS, RUNTIME_ROOT, folders_of_running
from wire.controller_lines import ConsoleError
from wire.malformed import MalformedPacket

WIDTH = 200  # where it is not a terminal's


class NoAnswer(Exception):
    """The controller cannot be asked, or refuses; the text says why and what to do."""


def ask(command: str, **fields: Any) -> Any:
    """Return the controller's answer; raise NoAnswer if there is none."""
    path = find_console()
    try:
        return answer_of(path, command, **fields)
    except PermissionError as error:
        raise NoAnswer("the network belongs to root: run it with sudo") from error
    except ConsoleError as error:
        raise NoAnswer(str(error)) from error
    except FileNotFoundError as error:
        raise NoAnswer("the network is still starting, or just ending; try again") from error
    except (OSError, MalformedPacket) as error:
        raise NoAnswer(f"the controller does not answer at {path} ({error})") from error


def find_console() -> Path:
    running = folders_of_running(RUNTIME_ROOT)
    if not running:
        raise NoAnswer(NONE_RUNS)
    return running[0] / f"{CONSOLE}.sock"


def answered(show: Callable[[], None]) -> int:
    """Show something; turn a missing answer into one line and an exit status."""
    try:
        show()
    except NoAnswer as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    return 0


def wide_console(width: int = WIDTH) -> Console:
    """Return where tables go: a terminal has a width, a file or a pipe takes lines so long.

    Strings are shown as they are: those of a run may look like markup.
    """
    columns = None if sys.stdout.isatty() else width
    return Console(highlight=False, markup=False, emoji=False, color_system=None, width=columns)
