"""Keys of two hosts, taken out of their stores as they come, and written into a file of each.

    DIR/alice/bob.keys    what alice has taken: keys of 32 bytes, one behind the other
    DIR/bob/alice.keys    the same of bob: the same keys, in the same order

As applications of both ends would: each takes what is its host's to hand out first, and the other
fetches it by its id. The stores have room for the next keys then, so that a session may go on.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO
from uuid import UUID

from applications.qkd.key_files import MissingKey
from applications.qkd.key_store import KeyStore, StoredKey
from applications.qkd.keyring import store_in
from qmn.options import BadInput
from qmn.results.run_folder import given_at_the_end
from topologies.system.processes.programs import NetworkError


class KeyHandout:
    """The keys that two hosts hand out, the one that has requested them first."""

    def __init__(self, stores: Sequence[KeyStore], files: Sequence[BinaryIO]) -> None:
        self._opener, self._acceptor = stores
        self._files = files
        self._early: dict[UUID, bytes] = {}  # taken at the acceptor; the opener stores them later
        self.count = 0

    def take(self) -> None:
        first = {each.key_id: each.key for each in _taken(self._opener)}
        self._write(list(first.values()), self._acceptor.take_all(list(first)))
        self._early |= {each.key_id: each.key for each in _taken(self._acceptor)}
        ready = [key_id for key_id in self._early if self._opener.has(key_id)]
        self._write(self._opener.take_all(ready), [self._early.pop(each) for each in ready])

    def _write(self, ours: list[bytes], theirs: list[bytes]) -> None:
        if ours != theirs:
            raise NetworkError("the keys of both hosts differ though their hashes agreed")
        for file, keys in zip(self._files, (ours, theirs), strict=True):
            file.write(b"".join(keys))
            file.flush()
        self.count += len(ours)


def _taken(store: KeyStore) -> list[StoredKey]:
    """Return all that a host hands out first; nothing while its folder changes under the count."""
    try:
        return store.take_oldest(store.mine)
    except MissingKey:
        return []


@contextmanager
def key_handout(folder: Path, ends: tuple[str, str], stores: Sequence[str]) -> Iterator[KeyHandout]:
    """Take keys of two hosts from these stores, at last when it ends.

    Raise BadInput if the folder cannot be written to.
    """
    with given_at_the_end(str(folder)), ExitStack() as opened:
        try:
            files = [opened.enter_context(_new_file(folder, *way)) for way in (ends, ends[::-1])]
        except OSError as error:
            raise BadInput(f"--hand-out {folder}: {error.strerror}; name a new folder") from error
        ways = zip(stores, ends[::-1], strict=True)
        handout = KeyHandout([store_in(Path(store), other) for store, other in ways], files)
        yield handout
        handout.take()


def _new_file(folder: Path, host: str, other: str) -> BinaryIO:
    private = folder / host
    for made in (folder, private):
        made.mkdir(mode=0o700, parents=True, exist_ok=True)
    return (private / f"{other}.keys").open("xb")
