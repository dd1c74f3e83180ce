"""A directory of secret keys, each of which is handed out once.

    directory/            mode 0700
        first/<key id>    keys that this end hands out first, to who asks for any key
        second/<key id>   keys that the other end hands out first; here they go out by their id

Both ends put the same keys, first at one end where second at the other, so that no key goes
to two pairs of applications. Files have mode 0600 and hold the key, nothing else. A key is
handed out by the one process that removes its file; the removal is on disk
before the key is returned. A crash can lose a key, never hand it out twice.

Words of ETSI GS QKD 014: `take_oldest` serves enc_keys, `take` dec_keys, `stored` is
stored_key_count and `capacity` max_key_count.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from uuid import UUID, uuid5

from applications.qkd import key_files
from applications.qkd.bits import Bits, pack
from applications.qkd.key_files import DuplicateKey, KeyStoreError, MissingKey

KEY_BITS = 256
_NAMESPACE = UUID("2f0c4cf4-6b7b-5d0e-9a43-5f7c1e3b8d10")


class StoreFull(KeyStoreError):
    """The store holds as many keys as it may."""


class InsecureStore(KeyStoreError):
    """Others may read the directory."""


@dataclass(frozen=True)
class StoredKey:
    """A key and the name that both ends know it by."""

    key_id: UUID
    key: bytes


def key_id(session: int, number: int) -> UUID:
    """Return the id of a key of a session; both ends derive the same."""
    return uuid5(_NAMESPACE, f"{session:016x}/{number}")


def cut(session: int, final: Bits, key_bits: int = KEY_BITS) -> list[StoredKey]:
    """Cut a final key into keys of key_bits, a multiple of 8; what is left over is dropped."""
    if key_bits < 8 or key_bits % 8:
        raise ValueError(f"keys of {key_bits} bits: the size shall be a multiple of 8")
    whole = final[: final.size // key_bits * key_bits].reshape(-1, key_bits)
    return [StoredKey(key_id(session, number), pack(bits)) for number, bits in enumerate(whole)]


class KeyStore:
    """The keys shared with one other end, in a directory of their own."""

    def __init__(self, directory: Path, capacity: int) -> None:
        """Open the store and make its directories; InsecureStore if others may enter them."""
        if capacity < 1:
            raise ValueError(f"a store of {capacity} keys, at least 1")
        self.capacity = capacity
        self._first, self._second = directory / "first", directory / "second"
        for folder in (directory, self._first, self._second):
            folder.mkdir(mode=0o700, exist_ok=True)
            status = folder.stat()
            if status.st_mode & 0o077 or status.st_uid != os.geteuid():
                raise InsecureStore(
                    f"{folder} has mode {status.st_mode & 0o777:o} and owner {status.st_uid}: "
                    "it must be 700 and yours"
                )
            key_files.clean(folder)

    @property
    def stored(self) -> int:
        return self.mine + self.theirs

    @property
    def mine(self) -> int:
        """How many of them this end hands out first."""
        return len(key_files.names(self._first))

    @property
    def theirs(self) -> int:
        """How many of them the other end hands out first."""
        return len(key_files.names(self._second))

    def has(self, key_id: UUID | str) -> bool:
        return any((folder / str(key_id)).exists() for folder in (self._first, self._second))

    def put(self, stored: StoredKey, *, first: bool) -> None:
        """Add a key, on disk when this returns; StoreFull or DuplicateKey changes nothing."""
        name = str(stored.key_id)
        if self.has(name):
            raise DuplicateKey(f"key {name} is in the store already")
        if self.stored >= self.capacity:
            raise self._full()
        folder = self._first if first else self._second
        key_files.write(folder / name, stored.key)
        if self.stored > self.capacity and self.discard(stored.key_id):
            raise self._full()  # another process was faster

    def put_all(self, keys: Sequence[StoredKey], *, first: bool) -> None:
        """Add keys, on disk when this returns; StoreFull or DuplicateKey: none is added."""
        key_files.create_all(self._first if first else self._second, self._new(keys))

    def put_halves(self, keys: Sequence[StoredKey], *, first: bool) -> None:
        """Add keys; this end hands out the even ones first, or else the odd ones. Or add none."""
        even, odd = (self._first, self._second) if first else (self._second, self._first)
        named = list(self._new(keys).items())
        key_files.create_all(even, dict(named[0::2]))
        try:
            key_files.create_all(odd, dict(named[1::2]))
        except OSError:
            for key in keys[0::2]:
                self.discard(key.key_id)
            raise

    def _new(self, keys: Sequence[StoredKey]) -> dict[str, bytes]:
        """Return keys by the names of their files; StoreFull or DuplicateKey: not to be added."""
        there = [*key_files.names(self._first), *key_files.names(self._second)]
        if len(there) + len(keys) > self.capacity:
            raise self._full()
        by_name = {str(key.key_id): key.key for key in keys}
        if twice := by_name.keys() & set(there):
            raise DuplicateKey(f"key {min(twice)} is in the store already")
        if len(by_name) < len(keys):
            raise DuplicateKey(f"{len(keys)} keys have {len(by_name)} ids")
        return by_name

    def take(self, key_id: UUID) -> bytes:
        """Hand out a key that the other end handed out first; MissingKey if it is not here."""
        return key_files.remove(self._second, str(key_id))

    def take_all(self, key_ids: Sequence[UUID]) -> list[bytes]:
        """Hand out keys that the other end handed out first; MissingKey if one is not here.

        Then none goes unless another process took some meanwhile.
        """
        names = [str(each) for each in key_ids]
        for name in names:
            if not (self._second / name).exists():
                raise MissingKey(f"key {name} is not in the store, or was handed out already")
        try:
            return [key_files.unlink(self._second, name) for name in names]
        finally:
            key_files.sync_folder(self._second)

    def take_oldest(self, count: int) -> list[StoredKey]:
        """Hand out `count` of the oldest keys that are this end's to hand out first.

        MissingKey if there are fewer, and then none goes.
        """
        # A folder that is added to meanwhile may tell a name twice.
        names = sorted(
            set(key_files.names(self._first)), key=lambda name: key_files.age(self._first / name)
        )
        taken: list[StoredKey] = []
        for name in names if len(names) >= count else ():
            if len(taken) == count:
                break
            try:
                taken.append(StoredKey(UUID(name), key_files.unlink(self._first, name)))
            except MissingKey:
                continue  # another process was faster
        key_files.sync_folder(self._first)
        if len(taken) < count:
            for key in taken:
                self.put(key, first=True)
            left = f"{len(names)} keys are" if names else "no key is"
            raise MissingKey(f"{left} left to hand out: distil more, or ask the other end")
        return taken

    def discard(self, unwanted: UUID) -> bool:
        """Remove a key that must not be used; whether it was still here."""
        for folder in (self._first, self._second):
            try:
                key_files.remove(folder, str(unwanted))
            except MissingKey:
                continue
            return True
        return False

    def _full(self) -> StoreFull:
        return StoreFull(f"the store holds {self.capacity} keys: take some before more are put")
