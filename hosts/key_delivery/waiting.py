"""Keys that were assigned to applications here, until they fetch them.

They are in memory: a key manager that ends takes them along, and no key goes out twice.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from uuid import UUID

from hosts.key_delivery.refusals import NOT_FOUND, bad_request, unauthorized, unavailable
from hosts.timeouts import FETCH_TIMEOUT_S
from wire.key_delivery import DeliveredKey

MOST_WAITING = 4096  # keys for one application


@dataclass
class _Waiting:
    master: str
    slaves: frozenset[str]
    missing: set[str]  # slaves that have not fetched it
    key: bytes
    until_s: float


class WaitingKeys:
    """Each key goes once to each slave that it was assigned to."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._keys: dict[UUID, _Waiting] = {}  # the oldest first
        self._counts: dict[str, int] = {}

    def require_capacity(self, slaves: Iterable[str], count: int) -> None:
        """Raise Refused if so many more keys cannot wait for these slaves."""
        self._throw_away()
        for slave in slaves:
            if self._counts.get(slave, 0) + count > MOST_WAITING:
                raise unavailable(f"{slave} has {self._counts[slave]} keys to fetch first")

    def add(self, master: str, slaves: Sequence[str], keys: Sequence[DeliveredKey]) -> None:
        """Let keys wait for slaves; raise Refused, and add none, if they cannot."""
        self.require_capacity(slaves, len(keys))
        if any(key.key_id in self._keys for key in keys):
            raise bad_request("a key_ID is assigned already")
        until_s = self._now_s() + FETCH_TIMEOUT_S
        for key in keys:
            waiting = _Waiting(master, frozenset(slaves), set(slaves), key.key, until_s)
            self._keys[key.key_id] = waiting
            for slave in slaves:
                self._counts[slave] = self._counts.get(slave, 0) + 1

    def fetch(self, caller: str, master: str, ids: Sequence[UUID]) -> list[DeliveredKey]:
        """Hand out keys to a slave; raise Refused, and hand out none, if one is not for it."""
        found = [self._keys.get(each) for each in ids]
        waiting = [each for each in found if each is not None and each.master == master]
        if any(caller not in each.slaves for each in waiting):
            raise unauthorized()
        if len(waiting) < len(ids) or any(caller not in each.missing for each in waiting):
            raise bad_request(NOT_FOUND)
        return [self._hand_out(caller, key_id) for key_id in ids]

    def _hand_out(self, caller: str, key_id: UUID) -> DeliveredKey:
        waiting = self._keys[key_id]
        waiting.missing.discard(caller)
        self._counts[caller] -= 1
        if not waiting.missing:
            del self._keys[key_id]
        return DeliveredKey(key_id, waiting.key)

    def _throw_away(self) -> None:
        now_s = self._now_s()
        for key_id in [each for each, key in self._keys.items() if key.until_s < now_s]:
            for slave in self._keys.pop(key_id).missing:
                self._counts[slave] -= 1
