"""The key store: each key goes out once, to any caller and whenever the power fails."""

import os
import subprocess
import sys
from pathlib import Path
from uuid import UUID, uuid4

import numpy as np
import pytest
from limits import SOON_S

from applications.qkd.key_files import DuplicateKey, MissingKey, write
from applications.qkd.key_store import InsecureStore, KeyStore, StoredKey, StoreFull, cut, key_id

ROOT = Path(__file__).resolve().parents[4]
RACE = """
import sys
from pathlib import Path
from applications.qkd.key_files import MissingKey
from applications.qkd.key_store import KeyStore
store = KeyStore(Path(sys.argv[1]), 1000)
print("ready", flush=True)
sys.stdin.readline()
while True:
    try:
        print(store.take_oldest(1)[0].key.hex())
    except MissingKey:
        break
"""


def keys(count: int) -> list[StoredKey]:
    return [StoredKey(uuid4(), os.urandom(32)) for _ in range(count)]


def test_both_ends_name_the_same_keys_alike() -> None:
    final = np.random.default_rng(1).integers(0, 2, 1000, dtype=np.uint8)
    alices, bobs = cut(7, final), cut(7, final.copy())
    assert alices == bobs
    assert [one.key_id for one in alices] == [key_id(7, 0), key_id(7, 1), key_id(7, 2)]
    assert all(len(one.key) == 32 for one in alices)
    assert np.packbits(final[256:512]).tobytes() == alices[1].key
    assert key_id(7, 0) == UUID("51a18a89-16c1-549b-bd94-540311e2bf50")
    assert key_id(8, 0) != key_id(7, 0)


@pytest.mark.parametrize("size", [0, 4, 12, -8])
def test_the_size_of_a_key_is_a_multiple_of_eight(size: int) -> None:
    with pytest.raises(ValueError, match="multiple of 8"):
        cut(7, np.zeros(100, dtype=np.uint8), size)


def test_a_key_goes_out_first_at_one_end_and_by_its_id_at_the_other(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir(mode=0o700)
    (tmp_path / "b").mkdir(mode=0o700)
    alice, bob = KeyStore(tmp_path / "a", 10), KeyStore(tmp_path / "b", 10)
    (key,) = keys(1)
    alice.put(key, first=True)
    bob.put(key, first=False)
    with pytest.raises(MissingKey):
        bob.take_oldest(1)[0]
    taken = alice.take_oldest(1)[0]
    assert bob.take(taken.key_id) == taken.key == key.key


def test_a_key_that_is_first_here_does_not_go_out_by_its_id(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    (key,) = keys(1)
    store.put(key, first=True)
    with pytest.raises(MissingKey):
        store.take(key.key_id)


def test_a_key_is_handed_out_once(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    (key,) = keys(1)
    store.put(key, first=False)
    assert store.take(key.key_id) == key.key
    with pytest.raises(MissingKey, match="handed out already"):
        store.take(key.key_id)
    with pytest.raises(MissingKey):
        KeyStore(tmp_path / "keys", 10).take(key.key_id)


def test_the_oldest_key_goes_out_first(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    some = keys(5)
    for age, key in enumerate(some):
        store.put(key, first=True)
        os.utime(tmp_path / "keys" / "first" / str(key.key_id), ns=(age, age))
    assert store.take_oldest(len(some)) == some
    with pytest.raises(MissingKey, match="no key is left"):
        store.take_oldest(1)[0]


def test_two_processes_never_get_the_same_key(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 1000)
    some = keys(300)
    for key in some:
        store.put(key, first=True)
    command = [sys.executable, "-c", RACE, str(tmp_path / "keys")]
    racers = [
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
        )
        for _ in range(2)
    ]
    for racer in racers:
        assert racer.stdout is not None
        assert racer.stdout.readline() == "ready\n"
    for racer in racers:
        assert racer.stdin is not None
        racer.stdin.write("\n")
        racer.stdin.flush()
    taken = [racer.communicate(timeout=SOON_S)[0].split() for racer in racers]
    assert all(racer.returncode == 0 for racer in racers)
    assert all(taken)
    assert sorted(taken[0] + taken[1]) == sorted(key.key.hex() for key in some)
    assert store.stored == 0


def test_a_full_store_takes_no_more_keys(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 3)
    some = keys(4)
    for number, key in enumerate(some[:3]):
        store.put(key, first=number % 2 == 0)
    with pytest.raises(StoreFull, match="holds 3 keys"):
        store.put(some[3], first=True)
    assert store.stored == 3
    store.take_oldest(1)[0]
    store.put(some[3], first=True)


@pytest.mark.parametrize("first", [True, False])
def test_a_key_is_put_once(tmp_path: Path, first: bool) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    (key,) = keys(1)
    store.put(key, first=True)
    with pytest.raises(DuplicateKey):
        store.put(StoredKey(key.key_id, b"other"), first=first)
    assert store.take_oldest(1)[0] == key


def test_a_file_is_never_written_over(tmp_path: Path) -> None:
    write(tmp_path / "key", b"first")
    with pytest.raises(DuplicateKey):
        write(tmp_path / "key", b"second")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"first"]


def test_an_unwanted_key_is_gone(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    some = keys(2)
    store.put(some[0], first=True)
    store.put(some[1], first=False)
    assert [store.discard(key.key_id) for key in some] == [True, True]
    assert not store.discard(some[0].key_id)
    assert store.stored == 0


def test_nobody_else_may_read_keys(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        store = KeyStore(tmp_path / "keys", 10)
        store.put(keys(1)[0], first=True)
    finally:
        os.umask(before)
    folders = [tmp_path / "keys", tmp_path / "keys" / "first", tmp_path / "keys" / "second"]
    assert [folder.stat().st_mode & 0o777 for folder in folders] == [0o700] * 3
    (file,) = (tmp_path / "keys" / "first").iterdir()
    assert file.stat().st_mode & 0o777 == 0o600


def test_a_directory_that_others_may_enter_is_refused(tmp_path: Path) -> None:
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys").chmod(0o750)
    with pytest.raises(InsecureStore, match="mode 750"):
        KeyStore(tmp_path / "keys", 10)


def test_what_a_crash_left_unfinished_is_no_key_and_is_removed(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait(timeout=SOON_S)
    left = tmp_path / "keys" / "first" / f"{uuid4()}.{ended.pid}.new"
    under_way = tmp_path / "keys" / "first" / f"{uuid4()}.{os.getpid()}.new"
    for path in (left, under_way):
        path.write_bytes(b"half")
    assert store.stored == 0
    with pytest.raises(MissingKey):
        store.take_oldest(1)[0]
    KeyStore(tmp_path / "keys", 10)
    assert not left.exists()
    assert under_way.exists()


def test_a_store_of_no_keys_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="a store of 0 keys"):
        KeyStore(tmp_path / "keys", 0)
