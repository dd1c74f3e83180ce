"""The errors of key delivery: HTTP status and message, in the standard's words if it has any."""

from collections.abc import Mapping, Sequence
from typing import Any

BAD_REQUEST, UNAUTHORIZED, UNAVAILABLE = 400, 401, 503
NOT_FOUND = "one or more keys specified are not found on KME"
NOT_MULTIPLE = "size shall be a multiple of 8"
NOT_SUPPORTED = "not all extension_mandatory parameters are supported"


class Refused(Exception):
    """A request that gets no keys."""

    def __init__(
        self, status: int, message: str, details: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        super().__init__(message)
        self.status, self.details = status, details


def bad_request(message: str, details: Sequence[Mapping[str, Any]] = ()) -> Refused:
    """Return the refusal of what cannot be asked."""
    return Refused(BAD_REQUEST, message, details)


def unauthorized() -> Refused:
    """Return the refusal of who may not ask; the standard gives it no body."""
    return Refused(UNAUTHORIZED, "")


def unavailable(message: str) -> Refused:
    """Return the refusal of what cannot be had now."""
    return Refused(UNAVAILABLE, message)
