"""Lets tshark dissect what wire/ encodes: captures of frames, fields that tshark shows."""

import atexit
import functools
import shutil
import struct
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from limits import SOON_S
from scapy.layers.inet import IP, TCP, UDP
from scapy.layers.l2 import Ether

from views.dissection.dissectors import script
from wire.metadata.header import METADATA_PORT
from wire.pcapng import LINKTYPE_ETHERNET, LINKTYPE_USER0, Interface, Packet, Writer

INTERFACES = [Interface("s1-eth1", LINKTYPE_ETHERNET), Interface("dispatcher", LINKTYPE_USER0)]
START_NS = 1_700_000_000_000_000_000
STEP_NS = 1_000_000
SEPARATOR, AGGREGATOR = "\t", "|"
IP_START, IP_LENGTH, IP_ENDS = 14, 16, 26  # bytes into a frame
UDP_LENGTH, UDP_HEAD = 38, 8
LUA_ERROR = "_ws.lua.error"


@functools.cache
def script_file() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="qmn-dissectors-"))
    atexit.register(shutil.rmtree, folder)
    file = folder / "qmn.lua"
    file.write_text(script())
    return file


def segment(
    data: bytes, connection: int = 0, seq: int = 1, answer: bool = False, port: int = METADATA_PORT
) -> bytes:
    """Return a TCP segment of a connection; answers go the other way."""
    head = bytearray(_head())
    ends = [(bytes([10, 0, 0, 1]), 20_000 + connection), (bytes([10, 0, 0, 2]), port)]
    (source, sport), (destination, dport) = reversed(ends) if answer else ends
    struct.pack_into("!H", head, IP_LENGTH, len(head) - IP_START + len(data))
    head[IP_ENDS : IP_ENDS + 8] = source + destination
    struct.pack_into("!HHI", head, IP_ENDS + 8, sport, dport, seq)
    return bytes(head + data)


@functools.cache
def _head() -> bytes:
    """Return the headers of a segment; scapy takes a millisecond to make them.

    Checksums do not fit the values: tshark checks none by default.
    """
    return bytes(_ether() / IP(src="10.0.0.1", dst="10.0.0.2") / TCP(flags="PA"))


def datagram(data: bytes, port: int) -> bytes:
    """Return an UDP datagram."""
    head = bytearray(_datagram_head(port))
    struct.pack_into("!H", head, IP_LENGTH, len(head) - IP_START + len(data))
    struct.pack_into("!H", head, UDP_LENGTH, UDP_HEAD + len(data))
    return bytes(head + data)


@functools.cache
def _datagram_head(port: int) -> bytes:
    """Return the headers of a datagram, as those of a segment."""
    return bytes(_ether() / IP(src="10.0.0.1", dst="10.0.0.2") / UDP(sport=port, dport=port))


def _ether() -> Any:
    return Ether(src="02:00:00:00:00:01", dst="02:00:00:00:00:02")


def tshark(
    folder: Path,
    frames: Sequence[bytes],
    *options: str,
    interface: int = 0,
    passes: int = 2,
    most_bytes: int | None = None,
) -> list[str]:
    """Return the lines that tshark prints of the frames; fail if a dissector has an error.

    Frames that name later ones are shown in the second pass alone. The capture has `most_bytes` of
    each frame at most.
    """
    file = folder / "frames.pcapng"
    with file.open("wb") as opened:
        writer = Writer(opened, INTERFACES)
        for number, frame in enumerate(frames):
            time_ns = START_NS + number * STEP_NS
            writer.write(Packet(time_ns, frame[:most_bytes], len(frame), interface))
    return tshark_file(file, *options, passes=passes)


def found(folder: Path, frames: Sequence[bytes], filters: Sequence[str]) -> list[int]:
    """Return how many of the frames tshark's display filters find, each by itself."""
    lines = tshark(folder, frames, "-q", "-z", ",".join(["io,stat,0", *filters]), passes=1)
    (row,) = [line for line in lines if "<>" in line]
    return [int(cell) for cell in row.strip("| ").split("|")[1::2]]


def tshark_file(file: Path, *options: str, passes: int = 2) -> list[str]:
    twice = ["-2"] if passes == 2 else []
    command = ["tshark", *twice, "-X", f"lua_script:{script_file()}", "-r", str(file), "-n"]
    done = subprocess.run(
        [*command, *options], capture_output=True, text=True, check=False, timeout=SOON_S
    )
    assert done.returncode == 0, done.stderr
    assert "Lua" not in done.stderr, done.stderr
    assert "Lua Error" not in done.stdout
    return done.stdout.splitlines()


def shown(
    folder: Path,
    frames: Sequence[bytes],
    names: Sequence[str],
    interface: int = 0,
    passes: int = 2,
    most_bytes: int | None = None,
) -> list[dict[str, list[str]]]:
    """Return, for each frame, all values of each field; fail if a dissector has an error."""
    options = ["-T", "fields", "-E", f"aggregator={AGGREGATOR}", "-E", f"separator={SEPARATOR}"]
    for name in [*names, LUA_ERROR]:
        options += ["-e", name]
    lines = tshark(
        folder, frames, *options, interface=interface, passes=passes, most_bytes=most_bytes
    )
    assert len(lines) == len(frames)
    rows: list[dict[str, list[str]]] = []
    for line in lines:
        *cells, error = line.split(SEPARATOR)
        assert not error, f"frame {len(rows) + 1}: an error in the script, as `tshark -V` says"
        rows.append(
            {
                name: cell.split(AGGREGATOR) if cell else []
                for name, cell in zip(names, cells, strict=True)
            }
        )
    return rows
