"""The command line as shtab and argparse-manpage read it: completion and the man page.

`setup/install` calls both. A path is completed from existing files, a run also from the
names in the folder of runs.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import shtab

from qmn.__main__ import described
from qmn.parser import Parser, listed
from views.archive.named_run import RUNS

RUN = {
    "bash": "_qmn_runs",
    "zsh": "_qmn_runs",
    "preamble": {
        "bash": f"""\
_qmn_runs() {{
  compgen -W "$(cd {RUNS} 2>/dev/null && echo *)" -- "$1"
  compgen -f -- "$1"
}}
""",
        "zsh": f"""\
_qmn_runs() {{
  compadd -- {RUNS}/*(N:t)
  _files
}}
""",
    },
}


def completed() -> argparse.ArgumentParser:
    """Return the parser of all verbs, with file names completed where one is meant."""
    parser = described(whole=True)
    # The man page describes each verb in its turn, and would not say which there are.
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = "\n".join([f"{parser.description}\n", *lists(parser)])
    for action in actions(parser):
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():  # of which the man page leaves epilogs out
                below.complete()
                below.description = "\n\n".join(filter(None, (below.description, below.epilog)))
        if action.metavar == "RUN":
            action.complete = RUN  # type: ignore[attr-defined]
        elif action.type is Path or action.metavar in ("FILE", "WHAT|FILE.toml"):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return parser


def lists(parser: Parser) -> Iterator[str]:
    for title, verbs in parser.verbs_under_headings():
        yield listed(title, {verb.dest: str(verb.help) for verb in verbs})


def actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for each in help_parsers(parser):
        yield from each._actions


def help_parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Yield a parser and all parsers of words below it, each with its options."""
    if isinstance(parser, Parser):
        parser.complete()
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in dict.fromkeys(action.choices.values()):
                yield from help_parsers(below)
