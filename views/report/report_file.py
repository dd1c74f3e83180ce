"""The report's file in a run folder, and why there is none."""

from pathlib import Path

from qmn.results.run_folder import give
from topologies.system.runs.runtime import EVENT_CAPTURE
from wire.malformed import MalformedPacket

AT_MOST_EVENT_BYTES = 10_000_000  # read at the end of a run: about 5 s


class NoReport(Exception):
    """There is no report of a run; the text says why."""


def made_report(run: Path) -> Path:
    """Write the report of a run and return the file; raise NoReport if it cannot be."""
    # matplotlib takes half a second to load: other verbs do not wait for it.
    from views.report.page import write_report
    from views.report.run_facts import BadRun

    try:
        file = write_report(run)
    except (BadRun, MalformedPacket) as error:
        raise NoReport(str(error)) from error
    except OSError as error:
        raise NoReport(f"{error.filename}: {error.strerror}") from error
    give(file)
    return file


def report_of_run(run: Path) -> str:
    """Make the report at the end of a run; return the file, or why there is none."""
    events = run / EVENT_CAPTURE
    size = events.stat().st_size if events.exists() else 0
    if size > AT_MOST_EVENT_BYTES:
        return f"not made, of {size / 1e6:,.0f} MB of events: `qmn report {run}` makes it"
    try:
        return str(made_report(run))
    except NoReport as error:
        return f"not made: {error}"
