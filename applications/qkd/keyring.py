"""Secrets shared with other hosts: one to authenticate by, and keys made together.

The secret stands for a store of random bytes that two hosts were given before: the pads of a
session are drawn from it by SHAKE-256 (FIPS 202), for a session once. A real installation
would hold the bytes themselves, and secrecy would rest on nothing computable.
"""

import hashlib
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from uuid import UUID

from applications.qkd.authentication import KeyPool, pool_bytes
from applications.qkd.bits import Bits
from applications.qkd.key_files import KeyStoreError
from applications.qkd.key_store import KeyStore, cut
from hosts.middleware.session.host_resources import HostResources
from wire.credentials import secret_file

MESSAGES = 8192  # of one direction of a session, at most
KEYRING = "keyring"  # its name among what a host keeps
CAPACITY = 262_144  # keys shared with one other host
MAX_RANGES = 1_000_000  # of sessions' numbers, that are remembered so that none is held twice


class NothingShared(Exception):
    """Two hosts lack what a session needs; the text says what."""


def keyring_of(resources: HostResources) -> "Keyring":
    if KEYRING not in resources.shared:
        secrets = PairSecrets(resources.name, resources.pair_secrets, resources.addresses)
        resources.shared[KEYRING] = Keyring(resources.name, secrets, resources.keys)
    keyring: Keyring = resources.shared[KEYRING]
    return keyring


def store_in(folder: Path, other: str) -> KeyStore:
    """Open the store of keys shared with a host, in a host's folder; KeyStoreError if it fails."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return KeyStore(folder / other, CAPACITY)
    except OSError as error:
        raise KeyStoreError(f"no store of keys can be in {folder}: {error}") from error


class HeldNumbers:
    """Numbers that were taken; those of a session's keys follow one another, and are one range."""

    def __init__(self) -> None:
        self._begins: list[int] = []
        self._ends: list[int] = []  # the last number of a range and one more

    def take(self, number: int) -> bool:
        """Take a number; False if it was taken before, or if no more can be remembered."""
        after = bisect_right(self._begins, number)
        end = self._ends[after - 1] if after else -1
        if number < end or len(self._begins) >= MAX_RANGES:
            return False
        if number == end:
            self._ends[after - 1] += 1
        else:
            self._begins.insert(after, number)
            self._ends.insert(after, number + 1)
        return True


class Keyring:
    def __init__(self, host: str, secrets: Mapping[str, str], folder: str) -> None:
        """Take the secrets by other host, and the folder of all keys ("": there is none)."""
        self.host = host
        self._secrets, self._folder = secrets, folder
        self._held: defaultdict[str, HeldNumbers] = defaultdict(HeldNumbers)  # by opener

    def pools(self, opener: str, acceptor: str, session: int) -> tuple[KeyPool, KeyPool]:
        """Return the authentication keys of a session: of what the opener says, the acceptor.

        Raise NothingShared if there are none, or if they were taken before.
        """
        other = acceptor if opener == self.host else opener
        if other not in self._secrets:
            raise NothingShared(f"{self.host} shares no authentication key with {other!r}")
        if not self._held[opener].take(session):
            raise NothingShared(
                f"the authentication key of session {session:016x} of {opener} was used before: "
                "is this a replay?"
            )
        label = f"{opener}/{acceptor}/{session:016x}"
        seed = bytes.fromhex(self._secrets[other])
        size = pool_bytes(MESSAGES)
        material = hashlib.shake_256(seed + label.encode()).digest(2 * size)
        return KeyPool(material[:size]), KeyPool(material[size:])

    def store(self, other: str) -> KeyStore:
        """Open the store of keys shared with a host; KeyStoreError if it cannot be."""
        if other not in self._secrets:
            raise KeyStoreError(f"{self.host} shares no keys with {other!r}")
        if not self._folder:
            raise KeyStoreError(f"{self.host} was given no folder to keep keys in")
        return store_in(Path(self._folder), other)

    def keep(self, other: str, session: int, final: Bits, *, opened: bool) -> list[UUID]:
        """Store a final key as keys of KEY_BITS; return their ids.

        Both ends hand out every second key first: the even ones the end that opened.
        KeyStoreError if they cannot be kept, and then none of them is.
        """
        keys, store = cut(session, final), self.store(other)
        try:
            store.put_halves(keys, first=opened)
        except OSError as error:
            raise KeyStoreError(f"keys cannot be kept in {self._folder}: {error}") from error
        return [key.key_id for key in keys]

    def keep_conference(self, names: Sequence[str], session: int, final: Bits) -> None:
        """Store a key of several hosts as keys of KEY_BITS.

        The first of the names hands them out; at the others they go out by their id.
        KeyStoreError if they cannot be kept, and then none of them is.
        """
        keys, store = cut(session, final), self._conference(names)
        try:
            store.put_all(keys, first=names[0] == self.host)
        except OSError as error:
            raise KeyStoreError(f"keys cannot be kept in {self._folder}: {error}") from error

    def withdraw_conference(self, names: Sequence[str], ids: list[UUID]) -> None:
        store = self._conference(names)
        for key_id in ids:
            store.discard(key_id)

    def _conference(self, names: Sequence[str]) -> KeyStore:
        if not self._folder:
            raise KeyStoreError(f"{self.host} was given no folder to keep keys in")
        return store_in(Path(self._folder), "+".join(names))

    def withdraw(self, other: str, ids: list[UUID]) -> None:
        if ids:
            store = self.store(other)
            for key_id in ids:
                store.discard(key_id)


class PairSecrets(Mapping[str, str]):
    """The secrets of one host by other host, in hex.

    They are files in a private folder (wire/credentials.py).
    """

    def __init__(self, host: str, folder: str, hosts: Callable[[], Collection[str]]) -> None:
        """Share with these hosts, in a folder of all secrets; "": with nobody."""
        self._host, self._folder, self._hosts = host, folder, hosts

    def __getitem__(self, other: str) -> str:
        if other not in self._others():
            raise KeyError(other)
        return secret_file(Path(self._folder), self._host, other).read_text()

    def __contains__(self, other: object) -> bool:
        return other in self._others()

    def __iter__(self) -> Iterator[str]:
        return iter(self._others())

    def __len__(self) -> int:
        return len(self._others())

    def _others(self) -> set[str]:
        return set(self._hosts()) - {self._host} if self._folder else set()
