"""The services that `qmn run` has, each with the options of its session."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from wire.metadata.vocabulary import Service
from wire.registered import SERVICE_VERBS, Registry

APPLICATION_PORT, SERVICE_PORT = 7, 9  # of messages, of other services


@dataclass(frozen=True)
class Verb:
    help: str
    unit: str  # what --count counts
    protocols: tuple[str, ...] = ()  # services that do it; none: the one of the verb's name
    topology: str = "sdc"  # by default
    eavesdropper: bool = False  # whether eve may be put on the fibre
    source: bool = False  # whether the host that makes pairs can be chosen
    scheduled: bool = False  # whether switches that swap take turns
    keys: bool = False  # whether it leaves keys
    hand_out: str = ""  # MODULE:NAME of a context that takes keys out as they come, as --hand-out
    line: bool = False  # whether its hosts are named together, in an order


OWN: Mapping[str, Verb] = MappingProxyType(
    {
        "distribute": Verb(
            "deliver pairs of a required fidelity to the memories of two hosts",
            "pairs",
            source=True,
        ),
        "swap": Verb(
            "deliver pairs to the memories of two hosts by swapping in quantum switches",
            "pairs",
            topology="chain",
            scheduled=True,
        ),
    }
)
VERBS: Mapping[str, Verb] = MappingProxyType(
    {
        name: verb
        for name, verb in Registry(SERVICE_VERBS, lambda each: isinstance(each, Verb), OWN).items()
        # One of a service that is left out (wire/light.py) is, too.
        if all(each.upper() in Service.__members__ for each in verb.protocols or (name,))
    }
)


def services_of(name: str) -> tuple[str, ...]:
    return VERBS[name].protocols or (name,)


def verb_of(service: str) -> Verb:
    return next(verb for name, verb in VERBS.items() if service in services_of(name))
