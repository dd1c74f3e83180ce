"""The snapshots of a controller, as bytes and as files: read back whole or not at all."""

import random
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from metadata_scene import FIBERS, FRAMED, Q1
from test_recovery import HOPS, OWNER, SOURCE, kept

from controller_apps.light.optics import SwitchPort
from controller_apps.sessions.snapshot import (
    decode_hosts,
    decode_session,
    encode_hosts,
    encode_session,
)
from controller_apps.sessions.state_folder import StateFolder
from wire.features import STORE, NodeFeatures
from wire.malformed import MalformedPacket
from wire.metadata.decoding import decode
from wire.metadata.setup import SETUP_LENGTH
from wire.metadata.vocabulary import Verdict

NOW = 50.0
HOSTS = {SwitchPort(Q1, port): host for port, host in FIBERS.items()}
ABLE = {at: replace(host, node_features=NodeFeatures(STORE, 32)) for at, host in HOSTS.items()}


def golden() -> bytes:
    """Return a session without a source's connection, written out field by field."""
    data = struct.pack("!dBH", 2.5, 1, 3)
    data += bytes([10, 0, 0, 1, 40000 >> 8, 40000 & 0xFF, 10, 0, 0, 2])
    data += struct.pack("!IBII", 100, 3, FRAMED.pairs, FRAMED.wavelength_pm) + FRAMED.encode()
    for _dpid, in_port, out_port in HOPS:
        data += struct.pack("!IBBQII", 0, 3, 1, Q1, in_port, out_port)
    return data


def test_a_session_is_kept_as_these_bytes() -> None:
    assert kept(rotation=3, seen=2.5, source=False) == golden()


def test_a_session_is_read_back_as_it_was() -> None:
    data = kept(rotation=3, seen=2.5)
    session = decode_session(data, NOW)
    assert (session.number, session.setup, session.seen) == (FRAMED.session, FRAMED, 2.5)
    assert (session.owner, session.light_owner, session.open) == (OWNER, OWNER, True)
    assert list(session.requests) == [OWNER, SOURCE]
    assert session.hops == HOPS
    request = session.requests[OWNER]
    assert (request.sequence, request.message) == (100, FRAMED.encode())
    answer = decode(request.answer)
    assert getattr(answer, "verdict", None) == Verdict.GRANTED
    assert encode_session(session) == data


def test_the_size_of_blocks_that_was_granted_is_kept_beside_what_was_asked_for() -> None:
    data = bytearray(golden())
    data[26:30] = struct.pack("!I", 32)
    session = decode_session(bytes(data), NOW)
    (request,) = session.requests.values()
    answer = decode(request.answer)
    assert (session.setup.pairs, getattr(answer, "pairs", None)) == (FRAMED.pairs, 32)
    assert encode_session(session) == data


def test_a_session_cut_short_or_too_long_is_malformed() -> None:
    data = kept()
    for wrong in (*(data[:length] for length in range(len(data))), data + b"\0"):
        with pytest.raises(MalformedPacket):
            decode_session(wrong, NOW)


def test_hosts_cut_short_or_too_long_are_malformed() -> None:
    at, host = next(iter(ABLE.items()))
    data = encode_hosts({at: host})
    for wrong in (*(data[:length] for length in range(1, len(data))), data + b"\0"):
        with pytest.raises(MalformedPacket):
            decode_hosts(wrong)


@pytest.mark.parametrize(
    ("at", "value"),
    [
        (0, struct.pack("!d", NOW + 1)),  # seen in the future: of another boot
        (0, struct.pack("!d", float("nan"))),
        (8, b"\0"),  # no request
        (9, bytes(2)),  # no path
        (25, b"\4"),  # rotation
        (26, bytes(4)),  # blocks of no pairs
        (26, struct.pack("!I", FRAMED.pairs + 1)),  # larger ones than were asked for
        (30, struct.pack("!I", FRAMED.wavelength_pm + 1)),  # another wavelength than was asked for
        (34 + 8, bytes(8)),  # session 0
        (34 + 16, b"\2"),  # a pair source owns no session
        (34 + 17, b"\2"),  # per-pair has no light of its own
        (34 + SETUP_LENGTH + 4, b"\4"),  # rotation of a path
        (34 + SETUP_LENGTH + 5, b"\0"),  # a path without hops
    ],
)
def test_what_no_controller_has_kept_is_malformed(at: int, value: bytes) -> None:
    data = bytearray(golden())
    data[at : at + len(value)] = value
    with pytest.raises(MalformedPacket):
        decode_session(bytes(data), NOW)


def test_a_stranger_s_connection_does_not_come_with_a_session() -> None:
    one, other = kept(), bytearray(kept())
    begin = 11 + 23 + SETUP_LENGTH  # of the second request
    assert other[begin : begin + 4] == bytes([10, 0, 0, 1])
    other[begin + 3] = 9
    assert decode_session(one, NOW)
    with pytest.raises(MalformedPacket, match="does not belong"):
        decode_session(bytes(other), NOW)


def test_mutated_bytes_are_malformed_or_a_session_that_is_written_alike() -> None:
    draw, data = random.Random(3), kept(rotation=1, seen=2.5)
    refused = 0
    for _ in range(5000):
        changed = bytearray(data)
        for _ in range(draw.randrange(1, 4)):
            changed[draw.randrange(len(changed))] = draw.randrange(256)
        try:
            session = decode_session(bytes(changed), NOW)
        except MalformedPacket:
            refused += 1
        else:
            assert encode_session(session) == changed
    assert 1000 < refused < 5000


def test_hosts_are_read_back_as_they_were() -> None:
    assert decode_hosts(encode_hosts(HOSTS)) == HOSTS
    assert decode_hosts(encode_hosts(ABLE)) == ABLE
    assert decode_hosts(b"") == {}
    with pytest.raises(MalformedPacket, match="UTF-8"):
        decode_hosts(encode_hosts(HOSTS).replace(b"alice", b"\xff" * 5))


def test_files_are_replaced_and_removed(tmp_path: Path) -> None:
    path = tmp_path / "state"
    folder = StateFolder(str(path))
    assert not folder.restored
    folder.keep_session(7, b"one")
    folder.keep_session(7, b"other")
    folder.keep_session(8, b"more")
    folder.keep_hosts(b"hosts")
    again = StateFolder(str(path))
    assert again.restored
    assert list(again.sessions()) == [(7, b"other"), (8, b"more")]
    assert again.hosts() == b"hosts"
    again.forget_session(7)
    again.forget_session(7)
    assert sorted(file.name for file in path.iterdir()) == [f"{8:016x}", "hosts"]
    assert path.stat().st_mode & 0o777 == 0o700


def test_a_file_half_written_by_a_controller_that_died_is_not_read(tmp_path: Path) -> None:
    folder = StateFolder(str(tmp_path / "state"))
    (tmp_path / "state" / f"{7:016x}.new").write_bytes(b"hal")
    assert list(folder.sessions()) == []


def test_a_folder_that_others_can_write_is_refused(tmp_path: Path) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    with pytest.raises(PermissionError, match="chmod 700"):
        StateFolder(str(tmp_path / "open"))


def test_without_a_folder_nothing_is_kept() -> None:
    folder = StateFolder("")
    folder.keep_session(7, b"one")
    folder.forget_session(7)
    assert (list(folder.sessions()), folder.hosts(), folder.restored) == ([], b"", False)
