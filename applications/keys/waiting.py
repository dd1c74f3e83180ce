"""Keys that were assigned to applications here, until they fetch them.

Each is a file, too, so that a key manager that is started again has them. That a slave has got its
key is on disk before the key goes out: a crash can lose a key, never hand it out twice.
"""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from uuid import UUID

from applications.keys.key_delivery import DeliveredKey
from applications.keys.refusals import NOT_FOUND, bad_request, unauthorized, unavailable
from applications.qkd.key_files import KeyStoreError, sync_folder
from applications.timeouts import FETCH_TIMEOUT_S

UNFINISHED = ".new"
MOST_WAITING = 4096  # keys for one application


@dataclass
class _Waiting:
    master: str
    slaves: frozenset[str]
    missing: set[str]  # slaves that have not fetched it
    key: bytes
    until_s: float

    def encode(self) -> str:
        fields = {"master": self.master, "key": self.key.hex(), "until_s": self.until_s}
        sets = {"slaves": sorted(self.slaves), "missing": sorted(self.missing)}
        return json.dumps(fields | sets)

    @classmethod
    def decode(cls, text: str) -> "_Waiting":
        fields = json.loads(text)
        slaves, missing = (frozenset(fields[name]) for name in ("slaves", "missing"))
        key = bytes.fromhex(fields["key"])
        return cls(fields["master"], slaves, set(missing), key, fields["until_s"])


class WaitingKeys:
    """Each key goes once to each slave that it was assigned to."""

    def __init__(self, now_s: Callable[[], float], folder: Path) -> None:
        """Take up the keys of a private folder, which is made; KeyStoreError if it cannot be."""
        self._now_s, self._folder = now_s, folder
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for unfinished in folder.glob(f"*{UNFINISHED}"):
            unfinished.unlink()
        entries = sorted(map(_read, folder.iterdir()), key=lambda each: each[1].until_s)
        latest_s = now_s() + FETCH_TIMEOUT_S  # by the clock of this network
        self._keys = {
            key_id: replace(waiting, until_s=min(waiting.until_s, latest_s))
            for key_id, waiting in entries
        }  # the oldest first
        self._counts: dict[str, int] = {}
        for waiting in self._keys.values():
            for slave in waiting.missing:
                self._counts[slave] = self._counts.get(slave, 0) + 1

    def require_capacity(self, slaves: Iterable[str], count: int) -> None:
        """Raise Refused if this number of further keys cannot wait for these slaves."""
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
            self._keep(key.key_id, waiting)
            for slave in slaves:
                self._counts[slave] = self._counts.get(slave, 0) + 1

    def fetch(self, caller: str, master: str, ids: Sequence[UUID]) -> list[DeliveredKey]:
        """Hand out keys to a slave; raise Refused, and hand out none, if one is not for it."""
        entries = [self._keys.get(key_id) for key_id in ids]
        waiting = [entry for entry in entries if entry is not None and entry.master == master]
        if any(caller not in each.slaves for each in waiting):
            raise unauthorized()
        if len(waiting) < len(ids) or any(caller not in each.missing for each in waiting):
            raise bad_request(NOT_FOUND)
        handed_out = [self._hand_out(caller, key_id) for key_id in ids]
        sync_folder(self._folder)
        return handed_out

    def _hand_out(self, caller: str, key_id: UUID) -> DeliveredKey:
        waiting = self._keys[key_id]
        waiting.missing.discard(caller)
        self._counts[caller] -= 1
        if waiting.missing:
            self._keep(key_id, waiting)
        else:
            del self._keys[key_id]
            self._file(key_id).unlink()
        return DeliveredKey(key_id, waiting.key)

    def _throw_away(self) -> None:
        now_s = self._now_s()
        for key_id in [each for each, key in self._keys.items() if key.until_s < now_s]:
            self._file(key_id).unlink()
            for slave in self._keys.pop(key_id).missing:
                self._counts[slave] -= 1

    def _file(self, key_id: UUID) -> Path:
        return self._folder / str(key_id)

    def _keep(self, key_id: UUID, waiting: _Waiting) -> None:
        unfinished = self._folder / f"{key_id}{UNFINISHED}"
        unfinished.touch(mode=0o600)
        unfinished.write_text(waiting.encode())
        unfinished.replace(self._file(key_id))


def _read(file: Path) -> tuple[UUID, _Waiting]:
    try:
        return UUID(file.name), _Waiting.decode(file.read_text())
    except (KeyError, ValueError, TypeError) as error:
        raise KeyStoreError(f"{file} is not an assigned key ({error}): take it away") from error
