"""The console that jobs and experiments print to."""

import sys

from rich.console import Console


def console_of_output() -> Console:
    """Return a console that writes control codes to a terminal alone.

    Notebooks set FORCE_COLOR, which would put them into their outputs.
    """
    return Console(highlight=False, force_terminal=sys.stdout.isatty())
