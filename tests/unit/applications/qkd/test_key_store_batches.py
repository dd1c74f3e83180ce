"""Several keys at once: all of them, or none."""

import os
from pathlib import Path
from uuid import uuid4

import pytest

from applications.qkd.key_files import DuplicateKey, MissingKey
from applications.qkd.key_store import KeyStore, StoredKey


def filled(folder: Path, *, first: bool, count: int = 5) -> tuple[KeyStore, list[StoredKey]]:
    store = KeyStore(folder, 100)
    keys = [StoredKey(uuid4(), os.urandom(32)) for _ in range(count)]
    store.put_all(keys, first=first)
    half = "first" if first else "second"
    for age, key in enumerate(keys):
        os.utime(folder / half / str(key.key_id), ns=(age, age))
    return store, keys


def test_the_oldest_keys_go_out_together(tmp_path: Path) -> None:
    store, keys = filled(tmp_path / "keys", first=True)
    assert store.take_oldest(3) == keys[:3]
    assert (store.mine, store.theirs, store.stored) == (2, 0, 2)


def test_of_too_few_keys_none_goes_out(tmp_path: Path) -> None:
    store, keys = filled(tmp_path / "keys", first=True)
    with pytest.raises(MissingKey, match="5 keys are left"):
        store.take_oldest(6)
    assert store.take_oldest(5) == keys


def test_keys_go_out_together_by_their_ids(tmp_path: Path) -> None:
    store, keys = filled(tmp_path / "keys", first=False)
    wanted = [keys[3], keys[1]]
    assert store.take_all([key.key_id for key in wanted]) == [key.key for key in wanted]
    assert (store.mine, store.theirs) == (0, 3)


def test_if_one_id_is_not_here_none_goes_out(tmp_path: Path) -> None:
    store, keys = filled(tmp_path / "keys", first=False)
    with pytest.raises(MissingKey):
        store.take_all([keys[0].key_id, uuid4()])
    assert store.theirs == 5


def test_if_another_process_is_faster_what_was_taken_goes_back(tmp_path: Path) -> None:
    store, keys = filled(tmp_path / "keys", first=True, count=2)
    # A name whose file is gone when it is opened, as of a key that another has taken just now.
    (tmp_path / "keys" / "first" / str(uuid4())).symlink_to(tmp_path / "nowhere")
    with pytest.raises(MissingKey):
        store.take_oldest(3)
    assert {key.key_id for key in store.take_oldest(2)} == {key.key_id for key in keys}


@pytest.mark.parametrize("there", [True, False])
def test_of_keys_of_which_one_is_there_none_is_added(tmp_path: Path, there: bool) -> None:
    store, keys = filled(tmp_path / "keys", first=True)
    more = [StoredKey(uuid4(), os.urandom(32)), StoredKey(keys[2].key_id, os.urandom(32))]
    with pytest.raises(DuplicateKey, match=str(keys[2].key_id)):
        store.put_all(more, first=there)
    assert store.take_oldest(5) == keys
    assert store.stored == 0


def test_keys_of_one_id_are_not_added(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    key = StoredKey(uuid4(), os.urandom(32))
    with pytest.raises(DuplicateKey, match="2 keys have 1 ids"):
        store.put_all([key, key], first=True)
    assert store.stored == 0


def test_if_one_file_cannot_be_written_no_key_is_added(tmp_path: Path) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    keys = [StoredKey(uuid4(), os.urandom(32)) for _ in range(3)]
    in_the_way = tmp_path / "keys" / "first" / f"{keys[1].key_id}.{os.getpid()}.new"
    in_the_way.mkdir()
    with pytest.raises(IsADirectoryError):
        store.put_all(keys, first=True)
    assert list((tmp_path / "keys" / "first").iterdir()) == [in_the_way]


@pytest.mark.parametrize("half", ["first", "second"])
@pytest.mark.parametrize("first", [True, False])
def test_if_a_file_of_either_half_cannot_be_written_no_key_is_added(
    tmp_path: Path, half: str, first: bool
) -> None:
    store = KeyStore(tmp_path / "keys", 10)
    keys = [StoredKey(uuid4(), os.urandom(32)) for _ in range(5)]
    of_half = keys[0::2] if (half == "first") == first else keys[1::2]
    in_the_way = tmp_path / "keys" / half / f"{of_half[1].key_id}.{os.getpid()}.new"
    in_the_way.mkdir()
    with pytest.raises(IsADirectoryError):
        store.put_halves(keys, first=first)
    assert store.stored == 0
    in_the_way.rmdir()
    store.put_halves(keys, first=first)
    assert (store.mine, store.theirs) == ((3, 2) if first else (2, 3))
