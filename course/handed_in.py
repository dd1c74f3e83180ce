"""A student's work: runs as they left them, and a file of answers."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from qmn.network.options import NetworkOptions
from qmn.results.run_result import RunResult
from qmn.results.schema import read_left
from wire.malformed import MalformedPacket
from wire.metadata import header

FLOW_MOD = b"\x05\x0e"  # OpenFlow 1.4
FIXED = 48  # bytes of one before its match


class Part(NamedTuple):
    """A part of an exercise, and whether it is done."""

    done: bool
    text: str


class FlowMod(NamedTuple):
    """An entry that a controller has ordered: its cookie, match and instructions as bytes."""

    cookie: int
    command: int
    match: bytes
    instructions: bytes


class Run:
    def __init__(self, folder: Path) -> None:
        """Read a run's folder; raise OSError or MalformedPacket if it is none."""
        result = read_left(folder)
        if not isinstance(result, RunResult):
            raise MalformedPacket(f"{folder} is of no job: hand in a run of `qmn run`")
        self.folder, self.result = folder, result

    @property
    def network(self) -> NetworkOptions:
        network = self.result.parameters
        return network if isinstance(network, NetworkOptions) else network.network

    @property
    def figures(self) -> Any:
        return self.result.asking

    @property
    def is_captured(self) -> bool:
        """Whether the captures have a set-up message of each session; it can be forged."""
        captured = b"".join(file.read_bytes() for file in sorted(self.folder.glob("s1-*.pcap")))
        begin = header.MAGIC.to_bytes(2, "big") + bytes([header.VERSION])
        starts = {
            captured[place + 8 : place + header.HEADER.size].hex()
            for place in places_of(begin, captured)
        }
        ids = self.result.sessions.ids
        return bool(ids) and starts >= set(ids)

    def flow_mods(self) -> Iterator[FlowMod]:
        """Yield the flow entries that the captures of the controller have."""
        for file in sorted(self.folder.glob("c0*.pcap")):
            captured = file.read_bytes()
            for place in places_of(FLOW_MOD, captured):
                length = int.from_bytes(captured[place + 2 : place + 4], "big")
                message = captured[place : place + length]
                if length < FIXED + 8 or len(message) < length:
                    continue
                size = int.from_bytes(message[FIXED + 2 : FIXED + 4], "big")
                behind = FIXED + (size + 7) // 8 * 8
                yield FlowMod(
                    int.from_bytes(message[8:16], "big"),
                    message[25],
                    message[FIXED : FIXED + size],
                    message[behind:],
                )


@dataclass(frozen=True)
class HandedIn:
    runs: list[Run]
    answers: dict[str, Any]

    def number(self, name: str) -> float:
        """Return an answer; NaN, which is near nothing, if it is no number."""
        value = self.answers.get(name)
        right = isinstance(value, int | float) and not isinstance(value, bool)
        return float(value) if right and value is not None else float("nan")


def places_of(pattern: bytes, data: bytes) -> Iterator[int]:
    place = data.find(pattern)
    while place >= 0:
        yield place
        place = data.find(pattern, place + 1)
