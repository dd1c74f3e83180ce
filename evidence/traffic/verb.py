"""qmn run load: heavy traffic."""

from evidence.traffic.request import LoadRequest
from qmn.jobs.start import describe_job
from qmn.network.options import KEYS
from qmn.parser import Parser

HELP = "heavy traffic: many sessions of many hosts"


def describe(parser: Parser) -> None:
    describe_job(parser, "evidence.traffic.job", LoadRequest, topology="ring", leave_out=KEYS)
