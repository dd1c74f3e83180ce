"""qmn run vpn: a tunnel whose keys are of light."""

from applications.keys.request import EveSchedule
from applications.vpn.request import VpnRequest
from qmn.jobs.start import describe_job
from qmn.parser import Parser

HELP = "move a file through a VPN with quantum keys"


def describe(parser: Parser) -> None:
    describe_job(parser, "applications.vpn.job", VpnRequest, EveSchedule)
