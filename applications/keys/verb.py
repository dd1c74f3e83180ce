"""qmn run keys: hosts keep keys, and deliver them to programs."""

from applications.keys.options import KeyServiceOptions
from applications.keys.request import EveSchedule, KeysRequest
from qmn.jobs.start import describe_job
from qmn.parser import Parser

HELP = "keep keys of hosts, and deliver them to programs (ETSI GS QKD 014)"


def describe(parser: Parser) -> None:
    describe_job(parser, "applications.keys.job", KeysRequest, KeyServiceOptions, EveSchedule)
