"""Text that a terminal or a page shows as it is: no control characters, which command a terminal.

The strings of a run may be another person's. A verb that prints them writes to PrintableOutput.
"""

import io
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

LAYOUT = str.maketrans("", "", "\n\t")


def printable(text: str) -> str:
    r"""Return a text in which each character that cannot be shown is written as in Python: \x1b.

    Line ends and tabs stay.
    """
    if text.translate(LAYOUT).isprintable():
        return text
    return "".join(
        each if each.isprintable() or each in "\n\t" else _escaped(each) for each in text
    )


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode()


class PrintableOutput(io.TextIOWrapper):
    """A standard stream that writes printable text alone."""

    def write(self, text: str, /) -> int:
        super().write(printable(text))
        return len(text)


def guard_standard_streams() -> None:
    """Let standard output and error of this process, as they are now, be PrintableOutputs."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        encoding, line, through = stream.encoding, stream.line_buffering, stream.write_through
        output = PrintableOutput(
            stream.detach(),
            encoding,
            "backslashreplace",
            line_buffering=line,
            write_through=through,
        )
        setattr(sys, name, output)


def console_of_output() -> "Console":
    """Return a console that writes control codes to a terminal alone.

    Notebooks set FORCE_COLOR, which would put them into their outputs.
    """
    from rich.console import Console  # which verbs that print plain text do not load

    return Console(highlight=False, force_terminal=sys.stdout.isatty())
