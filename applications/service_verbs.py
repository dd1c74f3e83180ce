"""The services of `qmn run` that packages of this folder add."""

from qmn.requests.service_verbs import Verb

CONFERENCE = Verb(
    "agree on one secret key of several hosts, by GHZ states",
    "states",
    eavesdropper=True,
    keys=True,
    line=True,
)
GHZ = Verb(
    "make GHZ states of several hosts, and estimate their fidelity",
    "states",
    line=True,
)
GRAPH = Verb(
    "make graph states of several hosts, and estimate their fidelity",
    "states",
    line=True,
)
QKD = Verb(
    "distribute secret keys",
    "sifted_bits",
    ("bb84", "bbm92", "e91", "mdi"),
    eavesdropper=True,
    keys=True,
    hand_out="applications.key_distribution.key_handout:key_handout",
)
SEAL = Verb("watch a fibre with entangled pairs", "compared", eavesdropper=True, source=True)
SENSE = Verb(
    "estimate the sum of phases at several hosts, by GHZ states or by separate probes",
    "states",
    line=True,
)
TELEPORT = Verb("teleport states", "states", source=True)
