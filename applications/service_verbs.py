"""The services of `qmn run` that packages of this folder add."""

from qmn.requests.service_verbs import Verb

SENSE = Verb(
    "estimate the sum of phases at several hosts, by GHZ states or by separate probes",
    "states",
    line=True,
)
