"""qmn course check N --run FOLDER --answer FILE: which parts of an exercise are done.

It reads what runs have left, and a file of answers. The status is 1 if a part is missing.
"""

import argparse
import sys
import tomllib
from pathlib import Path
from typing import Any

from course.exercises import EXERCISES
from course.handed_in import HandedIn, Run
from wire.malformed import MalformedPacket


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("course", description=__doc__)
    acts = parser.add_subparsers(metavar="ACT", required=True)
    acts.add_parser("list", help="the exercises").set_defaults(call=show)
    check = acts.add_parser("check", help="which parts of an exercise are done")
    check.add_argument("number", type=int, choices=tuple(EXERCISES), metavar="N", help="1 to 6")
    text = "of a run that is handed in (repeatable, in the order of the exercise)"
    check.add_argument("--run", type=Path, action="append", default=[], metavar="FOLDER", help=text)
    check.add_argument("--answer", type=Path, metavar="FILE", help="of answers, in TOML")
    check.set_defaults(call=call)


def show(_arguments: argparse.Namespace) -> int:
    for number, exercise in EXERCISES.items():
        print(f"{number}  {exercise.title} (course/{exercise.page})")
    return 0


def call(arguments: argparse.Namespace) -> int:
    """Print each part with its mark; return 1 if one is missing."""
    exercise = EXERCISES[arguments.number]
    try:
        handed_in = HandedIn(
            [Run(folder) for folder in arguments.run],
            tomllib.loads(arguments.answer.read_text()) if arguments.answer else {},
        )
    except (OSError, ValueError, MalformedPacket) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    print(f"exercise {arguments.number}: {exercise.title}")
    if len(handed_in.runs) != exercise.runs:
        print(f"missing  {exercise.runs} runs (--run), and there are {len(handed_in.runs)}")
        return 1
    parts = list(exercise.check(handed_in))
    for part in parts:
        print(f"{'done   ' if part.done else 'missing'}  {part.text}")
    return 0 if all(part.done for part in parts) else 1
