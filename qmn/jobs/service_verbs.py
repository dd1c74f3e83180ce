"""The services that `qmn run` has, and how the command line says what each can be told."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from hosts.middleware.services.conference.options import ConferenceOptions
from hosts.middleware.services.distribution.options import PROTOCOLS
from hosts.middleware.services.graph_states.options import SHAPES, WITNESSES
from hosts.middleware.services.key_distribution.options import BOUNDS, CORRECTIONS, KeyOptions
from hosts.middleware.services.sensing.options import PROBES
from hosts.middleware.services.teleportation import qubit_states
from qmn.options import Words

SERVICE_PORT = 9
KEYS = KeyOptions(host="", port=SERVICE_PORT)  # by default
CONFERENCE = ConferenceOptions(host="", port=SERVICE_PORT)


@dataclass(frozen=True)
class Verb:
    """A service as the command line has it."""

    help: str
    unit: str  # what --count counts
    options: Mapping[str, Words]  # of the service's own: how each is said (qmn.options)
    protocols: tuple[str, ...] = ()  # services that do it; none: the one of the verb's name
    topology: str = "sdc"  # by default
    eavesdropper: bool = False  # whether eve may be put on the fibre
    source: bool = False  # whether the host that makes pairs can be chosen
    scheduled: bool = False  # whether repeaters take turns
    keys: bool = False  # whether it leaves keys
    line: bool = False  # whether its hosts are named together, in an order


# What the services that leave pairs in memory can be told.
PAIRS: Mapping[str, Words] = MappingProxyType(
    {
        "fidelity": {
            "metavar": "F",
            "help": "at least, to Phi+ (0: any)",
        },
        "sample": {
            "metavar": "SHARE",
            "help": "of the pairs, sacrificed for the estimate (0.1)",
        },
        "purification": {
            "choices": PROTOCOLS,
            "help": "where it is needed (dejmps)",
        },
        "rounds": {
            "metavar": "N",
            "help": "of purification (as many as the fidelity needs)",
        },
    }
)
LINE = {
    "metavar": "A,B,C",
    "help": "hosts in the order of their links: each makes pairs with the next (alice,bob,charlie)",
}
VERBS: Mapping[str, Verb] = MappingProxyType(
    {
        "distribute": Verb(
            "put pairs of a wanted fidelity into the memories of two hosts",
            "pairs",
            PAIRS,
            source=True,
        ),
        "swap": Verb(
            "put pairs into the memories of two hosts by way of repeaters",
            "pairs",
            PAIRS,
            topology="repeaters",
            scheduled=True,
        ),
        "ghz": Verb(
            "make GHZ states of several hosts, and tell their fidelity",
            "states",
            {"line": LINE},
            line=True,
        ),
        "graph": Verb(
            "make graph states of several hosts, and tell their fidelity",
            "states",
            {
                "line": LINE,
                "graph": {
                    "metavar": "NAME|A-B,B-C",
                    "help": f"{', '.join(SHAPES)} (of the first host with all others), or edges",
                },
                "hub": {
                    "metavar": "HOST",
                    "help": "a host of the line that fuses pairs, and is measured out: it joins "
                    "its neighbours (none)",
                },
                "witness": {
                    "choices": WITNESSES,
                    "help": "the fidelity by stabilisers drawn of all, or a bound of it by a few "
                    f"settings, as many as the graph has colours ({WITNESSES[0]})",
                },
            },
            line=True,
        ),
        "conference": Verb(
            "agree on one secret key of several hosts, by GHZ states",
            "states",
            {
                "line": LINE,
                "test_fraction": {
                    "metavar": "F",
                    "help": "of the states, tested in X, and as many in Z "
                    f"({CONFERENCE.test_fraction:g})",
                },
                "max_qber": {
                    "metavar": "Q",
                    "help": f"no key above this error rate of any test ({CONFERENCE.max_qber:g})",
                },
                "epsilon": {
                    "metavar": "P",
                    "help": f"that the key is not secret, at most ({CONFERENCE.epsilon:g})",
                },
                "bound": {
                    "choices": tuple(BOUNDS),
                    "help": "of the key's length: proven, or that of endless keys "
                    f"({CONFERENCE.bound})",
                },
            },
            eavesdropper=True,
            keys=True,
            line=True,
        ),
        "sense": Verb(
            "tell the sum of phases at several hosts, by GHZ states or by separate probes",
            "states",
            {
                "line": LINE,
                "probes": {
                    "choices": PROBES,
                    "help": "qubits of GHZ states of all, or as many of each host's own (ghz)",
                },
            },
            line=True,
        ),
        "teleport": Verb(
            "teleport states",
            "states",
            {
                "state": {
                    "metavar": "NAME|THETA,PHI",
                    "help": f"each of them: {', '.join(qubit_states.NAMES)} or random (of these "
                    "six); on --backend dense also haar (random on the Bloch sphere) or angles in "
                    "rad, as 1.2,0.5 or pi/3,-pi/4 (random)",
                }
            },
            source=True,
        ),
        "qkd": Verb(
            "distribute secret keys",
            "sifted_bits",
            {
                "sifted_per_key": {
                    "metavar": "N",
                    "help": "sifted bits that one key is distilled of, at most "
                    f"({KEYS.sifted_per_key:,})",
                },
                "correction": {
                    "choices": tuple(CORRECTIONS),
                    "help": f"of errors ({KEYS.correction})",
                },
                "max_qber": {
                    "metavar": "Q",
                    "help": f"no key above this error rate ({KEYS.max_qber:g})",
                },
                "test_fraction": {
                    "metavar": "F",
                    "help": f"of the sifted bits, disclosed ({KEYS.test_fraction:g})",
                },
                "epsilon": {
                    "metavar": "P",
                    "help": f"that the key is not secret, at most ({KEYS.epsilon:g})",
                },
                "chsh_fraction": {
                    "metavar": "F",
                    "help": "e91: of the receiver's photons, for the CHSH test "
                    f"({KEYS.chsh_fraction:g})",
                },
                "chsh_margin": {
                    "metavar": "M",
                    "help": "e91: no key unless S is above 2 by this, or by five standard errors "
                    f"({KEYS.chsh_margin:g})",
                },
                "bound": {
                    "choices": tuple(BOUNDS),
                    "help": f"of the key's length: proven, or that of endless keys ({KEYS.bound})",
                },
            },
            ("bb84", "bbm92", "e91", "mdi"),
            eavesdropper=True,
            keys=True,
        ),
        "seal": Verb(
            "watch a fibre by entangled pairs",
            "compared",
            {
                "whole_error": {
                    "metavar": "P",
                    "help": "part of the pairs that differ though nobody is there, at most (0.01)",
                },
                "fraction": {
                    "metavar": "F",
                    "help": "of the photons that an intruder measures, who is to be found (0.25)",
                },
                "false_alarm": {
                    "metavar": "P",
                    "help": "that a test of a whole fibre ends in an alarm, at most (1e-06)",
                },
                "missed": {
                    "metavar": "P",
                    "help": "that a test takes such an intruder for nobody, at most (0.01)",
                },
            },
            eavesdropper=True,
            source=True,
        ),
    }
)


def verb_of(service: str) -> Verb:
    """Return how the command line has a service."""
    return next(verb for name, verb in VERBS.items() if service in (name, *verb.protocols))
