"""Secrets of two hosts each: the same for both, no other's, and none that nobody needs."""

from pathlib import Path

import pytest

from applications.qkd.keyring import PairSecrets
from wire.credentials import SECRET_BYTES

HOSTS = ("alice", "bob", "charlie")


def of(host: str, folder: Path) -> PairSecrets:
    return PairSecrets(host, str(folder), lambda: HOSTS)


def test_both_have_the_same_and_no_two_pairs_do(tmp_path: Path) -> None:
    shared = of("alice", tmp_path)["bob"]
    assert len(bytes.fromhex(shared)) == SECRET_BYTES
    assert of("bob", tmp_path)["alice"] == of("alice", tmp_path)["bob"] == shared
    assert len({shared, of("alice", tmp_path)["charlie"], of("bob", tmp_path)["charlie"]}) == 3


def test_only_those_that_are_needed_are_drawn_and_nobody_else_reads_them(tmp_path: Path) -> None:
    assert set(of("alice", tmp_path)) == {"bob", "charlie"}
    assert list(tmp_path.iterdir()) == []
    assert of("bob", tmp_path)["alice"]
    (file,) = tmp_path.iterdir()
    assert file.stat().st_mode & 0o077 == 0


def test_a_stranger_shares_nothing_nor_does_anyone_without_a_folder(tmp_path: Path) -> None:
    for secrets, other in ((of("alice", tmp_path), "mallory"), (PairSecrets("a", "", list), "b")):
        assert other not in secrets
        with pytest.raises(KeyError):
            _ = secrets[other]
    assert "alice" not in of("alice", tmp_path)
