"""The refusals of key delivery: HTTP status and message, in the standard's words if it has any."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

BAD_REQUEST, UNAUTHORIZED, UNAVAILABLE = 400, 401, 503
NOT_FOUND = "one or more keys specified are not found on KME"
NOT_MULTIPLE = "size shall be a multiple of 8"
NOT_SUPPORTED = "not all extension_mandatory parameters are supported"


class Refused(Exception):
    def __init__(
        self, status: int, message: str, details: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        super().__init__(message)
        self.status, self.details = status, details


def bad_request(message: str, details: Sequence[Mapping[str, Any]] = ()) -> Refused:
    return Refused(BAD_REQUEST, message, details)


def unauthorized() -> Refused:
    """Return the refusal of who may not ask; the standard gives it no body."""
    return Refused(UNAUTHORIZED, "")


def unavailable(message: str) -> Refused:
    return Refused(UNAVAILABLE, message)


class Allowance:
    """Counts stored keys against a rate, for each application on its own."""

    def __init__(self, keys_per_s: float, burst: int, now_s: Callable[[], float]) -> None:
        """Allow `burst` keys at once and `keys_per_s` in the long run; 0: as many as there are."""
        self._rate, self._burst, self._now_s = keys_per_s, burst, now_s
        self._left: dict[str, tuple[float, float]] = {}  # keys, and when

    def take(self, caller: str, count: int) -> None:
        """Count keys; raise Refused if they are too many just now."""
        if self._rate <= 0:
            return
        now = self._now_s()
        left, since = self._left.get(caller, (float(self._burst), now))
        left = min(float(self._burst), left + (now - since) * self._rate)
        if count > left:
            raise unavailable(
                f"{caller} has asked for more than {self._rate:g} keys a second: ask again in "
                f"{(min(count, self._burst) - left) / self._rate:.3g} s"
            )
        self._left[caller] = left - count, now
