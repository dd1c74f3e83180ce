"""qmn run JOB: start a network, do its job, report, clean up."""

from typing import Any

from qmn.jobs import keys, service, superdense


def add_parser(verbs: Any) -> None:
    """Describe the verb and its jobs."""
    words = "start a network and do its job"
    parser = verbs.add_parser("run", help=words, description=__doc__)
    parser.set_defaults(needs_root=True)
    jobs = parser.add_subparsers(dest="job", metavar="JOB", required=True)
    superdense.add_parsers(jobs)
    service.add_parsers(jobs)
    keys.add_parser(jobs)
