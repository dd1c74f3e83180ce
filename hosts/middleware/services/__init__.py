"""The services of a host, by their place in the vocabulary; each is a file here."""

from collections.abc import Mapping
from types import MappingProxyType

from hosts.middleware.services.conference import conference
from hosts.middleware.services.distribution import distribute
from hosts.middleware.services.ghz import ghz
from hosts.middleware.services.graph_states import graph_states
from hosts.middleware.services.key_distribution import protocols
from hosts.middleware.services.sealing import seal
from hosts.middleware.services.sensing import sensing
from hosts.middleware.services.superdense import superdense
from hosts.middleware.services.swapping import swap
from hosts.middleware.services.teleportation import teleport
from hosts.middleware.session.ends import ServiceKind
from wire.metadata.vocabulary import Service

KINDS: Mapping[Service, ServiceKind] = MappingProxyType(
    {
        kind.service: kind
        for kind in (
            superdense.KIND,
            superdense.RETURN_KIND,
            protocols.BB84,
            protocols.BBM92,
            protocols.E91,
            protocols.MDI,
            conference.KIND,
            distribute.KIND,
            ghz.KIND,
            graph_states.KIND,
            seal.KIND,
            sensing.KIND,
            swap.KIND,
            teleport.KIND,
        )
    }
)
NAMES = {service.name.lower(): kind for service, kind in KINDS.items()}  # what users call them
