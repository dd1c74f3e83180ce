"""qmn set WHAT …: change the network that runs."""

from typing import Any

from qmn.needs import Needs
from qmn.parser import add_kinds

WHAT = {
    "link": ("cut or mend links", "qmn.changes.link:describe"),
    "fault": ("make a quantum switch faulty, or repair it", "qmn.changes.fault:describe"),
    "tap": ("put an eavesdropper on fibres", "qmn.changes.fibers:describe_tap"),
    "classical": ("power of classical light in fibres", "qmn.changes.fibers:describe_classical"),
    "calibrate": ("compensate the drift of fibres", "qmn.changes.fibers:describe_calibrate"),
    "host": ("override a setting in new sessions", "qmn.changes.controller:describe_host"),
    "policy": ("reload the policy file", "qmn.changes.controller:describe_policy"),
}


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("set", description=__doc__)
    add_kinds(parser, "WHAT", WHAT, required=True)
    parser.set_defaults(needs=Needs.RUNNING)
