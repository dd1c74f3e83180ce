"""Secrets of pairs of hosts: keys that authenticate, used once, and keys that both keep."""

import os
from pathlib import Path

import numpy as np
import pytest

from applications.qkd.bits import Bits
from applications.qkd.key_files import DuplicateKey, KeyStoreError
from applications.qkd.key_store import StoreFull, cut
from applications.qkd.keyring import CAPACITY, Keyring, NothingShared

SECRET = "5e" * 32
SESSION = 0x0123456789ABCDEF


def rings(folder: Path) -> tuple[Keyring, Keyring]:
    return (
        Keyring("alice", {"bob": SECRET}, str(folder / "alice")),
        Keyring("bob", {"alice": SECRET}, str(folder / "bob")),
    )


def final(bits: int = 2700) -> Bits:
    return np.random.default_rng(1).integers(0, 2, bits, dtype=np.uint8)


def test_both_hosts_have_the_same_authentication_keys_for_each_direction(tmp_path: Path) -> None:
    alice, bob = (ring.pools("alice", "bob", SESSION) for ring in rings(tmp_path))
    taken = [[pool.take(4096) for pool in pools] for pools in (alice, bob)]
    assert taken[0] == taken[1]
    assert taken[0][0] != taken[0][1]


def test_another_session_or_opener_has_other_authentication_keys(tmp_path: Path) -> None:
    ring, _bob = rings(tmp_path)
    sessions = [("alice", "bob", 1), ("alice", "bob", 2), ("bob", "alice", 1)]
    pools = [pool for session in sessions for pool in ring.pools(*session)]
    assert len({pool.take(64) for pool in pools}) == len(pools)


def test_the_authentication_key_of_a_session_is_given_once(tmp_path: Path) -> None:
    ring, _bob = rings(tmp_path)
    ring.pools("alice", "bob", SESSION)
    with pytest.raises(NothingShared, match="was used before"):
        ring.pools("alice", "bob", SESSION)


def test_a_stranger_shares_nothing(tmp_path: Path) -> None:
    ring, _bob = rings(tmp_path)
    with pytest.raises(NothingShared, match="no authentication key with 'eve'"):
        ring.pools("eve", "alice", SESSION)
    with pytest.raises(KeyStoreError, match="no keys with"):
        ring.store("../eve")


def test_without_a_folder_nothing_is_kept() -> None:
    with pytest.raises(KeyStoreError, match="no folder"):
        Keyring("alice", {"bob": SECRET}, "").store("bob")


def test_every_key_is_handed_out_first_by_one_end(tmp_path: Path) -> None:
    alice, bob = rings(tmp_path)
    key = final()
    ids = alice.keep("bob", SESSION, key, opened=True)
    assert bob.keep("alice", SESSION, key, opened=False) == ids
    assert len(ids) == key.size // 256
    ends = alice.store("bob"), bob.store("alice")
    for mine, theirs in (ends, ends[::-1]):
        handed = mine.take_oldest(1)[0]
        assert theirs.take(handed.key_id) == handed.key


def test_keys_that_do_not_all_fit_are_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alice, _bob = rings(tmp_path)
    monkeypatch.setattr("applications.qkd.keyring.CAPACITY", 7)  # of ten keys, five and five
    with pytest.raises(StoreFull):
        alice.keep("bob", SESSION, final(), opened=True)
    assert alice.store("bob").stored == 0


def test_a_disk_that_fails_is_told_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alice, _bob = rings(tmp_path)
    store = alice.store("bob")
    rename = os.rename
    named: list[str] = []

    def rename_some(source: str, target: str, *, src_dir_fd: int, dst_dir_fd: int) -> None:
        if len(named) == 7:
            raise OSError(28, "No space left on device")
        named.append(target)
        rename(source, target, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd)

    monkeypatch.setattr("os.rename", rename_some)
    with pytest.raises(KeyStoreError, match="No space left"):
        alice.keep("bob", SESSION, final(), opened=True)
    assert len(named) == 7
    assert store.stored == 0
    (tmp_path / "file").touch()
    with pytest.raises(KeyStoreError, match="no store of keys can be"):
        Keyring("alice", {"bob": SECRET}, str(tmp_path / "file")).store("bob")


def test_keys_of_a_known_id_leave_the_store_as_it_was(tmp_path: Path) -> None:
    alice, _bob = rings(tmp_path)
    store, keys = alice.store("bob"), cut(SESSION, final())
    store.put(keys[3], first=False)
    with pytest.raises(DuplicateKey):
        alice.keep("bob", SESSION, final(), opened=True)
    assert store.stored == 1
    assert store.take(keys[3].key_id) == keys[3].key


def test_keys_of_a_session_that_failed_are_withdrawn(tmp_path: Path) -> None:
    alice, _bob = rings(tmp_path)
    ids = alice.keep("bob", SESSION, final(), opened=True)
    alice.withdraw("bob", ids)
    assert alice.store("bob").stored == 0
    assert CAPACITY > len(ids) > 0
