"""The services of a host, by their place in the vocabulary: those here, and those of packages."""

import logging
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import EntryPoint
from types import MappingProxyType

from hosts.middleware.services import distribute, swapping
from hosts.middleware.services.superdense import superdense
from hosts.middleware.session.ends import ServiceKind
from wire.light import GROUP, registered_services
from wire.metadata.vocabulary import Service
from wire.registered import BadPackage, load

log = logging.getLogger("packages")


@cache
def kinds() -> Mapping[Service, ServiceKind]:
    """Return all; those of packages import what is beside this, and are imported only here."""
    ours = (
        superdense.KIND,
        superdense.RETURN_KIND,
        distribute.KIND,
        swapping.KIND,
    )
    return MappingProxyType({kind.service: kind for kind in (*ours, *_theirs())})


def _theirs() -> Iterator[ServiceKind]:
    for service in registered_services():
        try:
            ends = EntryPoint(service.name, service.ends, GROUP)
            yield load(ends, lambda kind: isinstance(kind, ServiceKind))
        except BadPackage as error:
            log.warning("%s: %s", GROUP, error)


@cache
def named() -> Mapping[str, ServiceKind]:
    return MappingProxyType({service.name.lower(): kind for service, kind in kinds().items()})
