"""The kinds of requests, by the service or the job of the result that records them."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, is_dataclass
from types import MappingProxyType
from typing import Any

from hosts.middleware.services import named
from qmn.requests.recording import read_recorded, recorded_fields
from qmn.requests.request import Request
from qmn.requests.service import ServiceRequest
from qmn.requests.service_verbs import APPLICATION_PORT, SERVICE_PORT, VERBS, services_of
from qmn.requests.superdense import SERVICE, SuperdenseRequest
from wire.registered import REQUESTS, Registry

LOAD = "load"  # a job, whatever its sessions are of


@dataclass(frozen=True)
class RecordedRequest:
    """The class of a request, and what reading a recorded one needs beside its parameters."""

    kind: type[Any]
    known: Mapping[str, Any] = field(default_factory=dict)  # fields that are not recorded
    parts: Mapping[str, type[Any]] = field(default_factory=dict)  # their classes

    def read(self, parameters: Mapping[str, Any], **elsewhere: Any) -> Request:
        """Return the request; `elsewhere` are fields that a result has beside the request.

        Raise MalformedPacket for a name or a value that no such request has.
        """
        request: Request = read_recorded(
            self.kind, parameters, self.parts, **self.known, **elsewhere
        )
        return request

    @property
    def fields(self) -> dict[str, Any]:
        return recorded_fields(self.kind, self.parts)


RECORDED_REQUESTS: Mapping[str, RecordedRequest] = MappingProxyType(
    {
        SERVICE: RecordedRequest(SuperdenseRequest, {"port": APPLICATION_PORT}),
        **{
            service: RecordedRequest(
                ServiceRequest,
                {"service": service, "port": SERVICE_PORT},
                {"options": named()[service].options},
            )
            for name in VERBS
            for service in services_of(name)
        },
        **{
            name: RecordedRequest(kind)
            for name, kind in Registry[Any](REQUESTS, is_dataclass, {}).items()
        },
    }
)


def job_of(service: str, parts: Collection[str]) -> str:
    """Return the key of a result's request, by its service and the parts of its job."""
    return LOAD if LOAD in parts else service
