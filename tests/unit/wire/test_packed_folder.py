"""Folders as bytes: golden bytes, and what is refused whole."""

import struct

import pytest

from wire import packed_folder
from wire.malformed import MalformedPacket
from wire.packed_folder import Entry, Kind, decode, encode

ENTRIES = [
    Entry("keys", Kind.FOLDER),
    Entry("keys/first", Kind.FILE, 1_000_000_007, b"\x00\xff"),
    Entry("run.sh", Kind.PROGRAM, 2**63, b"ls"),
]
GOLDEN = (
    bytes.fromhex("00 0004 0000000000000000 00000000") + b"keys"
    b"\x01" + bytes.fromhex("000a 000000003b9aca07 00000002") + b"keys/first\x00\xff"
    b"\x02" + bytes.fromhex("0006 8000000000000000 00000002") + b"run.shls"
)


def packed(*entries: tuple[bytes, int, bytes]) -> bytes:
    """Return names, kinds and contents as anybody can send them."""
    return b"".join(
        struct.pack("!BHQI", kind, len(name), 0, len(data)) + name + data
        for name, kind, data in entries
    )


def test_a_folder_is_these_bytes() -> None:
    assert encode(ENTRIES) == GOLDEN
    assert decode(GOLDEN) == ENTRIES
    assert decode(b"") == []


@pytest.mark.parametrize(
    "name",
    [
        *(b"", b"/", b"/etc/passwd", b"//x", b"..", b"../x", b"a/..", b"a/../../x", b".", b"./x"),
        *(b"a//x", b"a/", b"\0", b"x\0y", b"\xff", b"x" * 256),
    ],
)
@pytest.mark.parametrize("kind", [0, 1, 2])
def test_names_that_are_not_of_something_inside_are_refused(name: bytes, kind: int) -> None:
    good = packed((b"a", 0, b""), (b"a/x", 1, b"1"))
    assert decode(good)
    with pytest.raises(MalformedPacket):
        decode(good + packed((name, kind, b"")))


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        ([(b"x", 1, b"1"), (b"x", 1, b"2")], "'x' is twice"),
        ([(b"x", 0, b""), (b"x", 1, b"2")], "'x' is twice"),
        ([(b"a/x", 1, b"1")], "'a/x' is in no folder"),
        ([(b"a", 1, b"1"), (b"a/x", 1, b"1")], "'a/x' is in no folder"),  # below a file
        ([(b"a/x", 1, b"1"), (b"a", 0, b"")], "'a/x' is in no folder"),
        ([(b"a", 0, b"1")], "the folder 'a' has 1 bytes"),
        ([(b"a", 3, b"")], "3 is not a valid Kind"),  # as a link would be
        ([(b"a", 255, b"")], "255 is not a valid Kind"),
    ],
)
def test_what_cannot_be_in_a_folder_is_refused(
    entries: list[tuple[bytes, int, bytes]], text: str
) -> None:
    with pytest.raises(MalformedPacket, match=text):
        decode(packed((b"before", 1, b""), *entries))


def test_names_have_so_many_parts_at_most() -> None:
    chain = [(b"/".join([b"a"] * parts), 0, b"") for parts in range(1, 34)]
    assert len(decode(packed(*chain[:-1]))) == 32
    with pytest.raises(MalformedPacket, match="not a name"):
        decode(packed(*chain))


def test_a_length_beyond_the_end_is_refused() -> None:
    with pytest.raises(MalformedPacket, match="cut off"):
        decode(struct.pack("!BHQI", 1, 1, 0, 2**32 - 1) + b"x")


def test_too_much_is_refused_by_both_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packed_folder, "MOST_BYTES", len(GOLDEN) - 1)
    for refused in (lambda: decode(GOLDEN), lambda: encode(ENTRIES)):
        with pytest.raises(MalformedPacket, match="more than"):
            refused()
    monkeypatch.undo()
    monkeypatch.setattr(packed_folder, "MOST_ENTRIES", 2)
    for refused in (lambda: decode(GOLDEN), lambda: encode(ENTRIES)):
        with pytest.raises(MalformedPacket, match="in 2 files and folders"):
            refused()


@pytest.mark.parametrize("name", ["../x", "/x", "not-utf-8-\udcff", ""])
def test_what_nobody_would_take_is_not_written(name: str) -> None:
    with pytest.raises(ValueError, match="not a name inside"):
        encode([Entry(name, Kind.FILE)])
