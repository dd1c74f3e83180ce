"""qmn run load: heavy traffic."""

from evidence.traffic.request import LoadRequest
from qmn.jobs.start import describe_job
from qmn.parser import Parser
from wire.parameters.network import KeySettings

HELP = "heavy traffic: many sessions of many hosts"


def describe(parser: Parser) -> None:
    job = "evidence.traffic.job"
    describe_job(parser, job, LoadRequest, topology="ring", without=(KeySettings,))
