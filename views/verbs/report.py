"""qmn report RUN: rebuild the report of a finished run: report.html, a single file."""

import argparse
import sys
from typing import Any

from views.archive.named_run import add_run
from views.report.report_file import NoReport, made_report


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("report", description=__doc__)
    add_run(parser)
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Make the report; turn what is wrong into one line and an exit status."""
    try:
        print(made_report(arguments.run))
    except NoReport as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    return 0
