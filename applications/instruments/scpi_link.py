"""A TCP connection to an instrument that speaks SCPI: a line out, a line back.

SCPI-99 volume 1 (error queue, `:SYSTem:ERRor?`) and IEEE 488.2 (`*CLS`, `*IDN?`, `*OPC?`).
Each request is followed by `:syst:err?`, so that one that is refused, and therefore has no
answer, differs from one that is slow.

Replies of a matrix switch, read strictly: anything else is a GarbledReply.

connections  (@1,2),(@17,18)   ingress ports, then the egress port of each; none: (@),(@)
errors       -222,"Data out of range"      0,"No error"
powers       (-10.53,-60.00)   dBm
port states  (E,E,F)           enabled, disabled (D), failed
"""

import asyncio
import re
import string
from collections.abc import Iterable, Mapping

from qswitch_agent.hardware.optics import HardwareRefusal

# ASCII: what float() takes for a space, or for a digit, and nothing more.
CONNECTIONS = re.compile(r"\(@([\d, ]*)\),\s*\(@([\d, ]*)\)", re.ASCII)
ERROR = re.compile(r'([+-]?\d{1,6}),\s*"([ -~]*)"', re.ASCII)
LIST = re.compile(r"\(([^()]*)\)")
NUMBER = re.compile(r"\s*[+-]?\d{1,4}(\.\d{1,9})?([eE][+-]?\d)?\s*", re.ASCII)
STATE = re.compile(r"\s*([EDF])\s*", re.ASCII)


class GarbledReply(ValueError):
    """An invalid reply of the instrument; the message quotes it."""

    def __init__(self, what: str, text: str) -> None:
        shown = text if len(text) <= 60 else f"{text[:60]}..."
        super().__init__(f"{shown!r} are not {what}")


def channels(ports: Iterable[int]) -> str:
    return f"(@{','.join(map(str, ports))})"


def pairs(connections: Mapping[int, int]) -> str:
    """Return connections (ingress to egress) as two channel lists."""
    return f"{channels(connections)},{channels(connections.values())}"


def read_connections(text: str) -> dict[int, int]:
    match = CONNECTIONS.fullmatch(text)
    if match is None:
        raise GarbledReply("connections", text)
    try:
        sides = [[int(port) for port in side.split(",")] if side else [] for side in match.groups()]
    except ValueError as error:
        raise GarbledReply("connections", text) from error
    connections = dict(zip(*sides, strict=False))
    if not len(sides[0]) == len(sides[1]) == len(connections) == len(set(sides[1])):
        raise GarbledReply("connections", text)
    return connections


def is_error(text: str) -> bool:
    """Say whether a line is an answer to `:syst:err?`."""
    return ERROR.fullmatch(text) is not None


def read_error(text: str) -> tuple[int, str]:
    """Return number and text of an error; 0 is none."""
    match = ERROR.fullmatch(text)
    if match is None:
        raise GarbledReply("errors", text)
    return int(match[1]), match[2]


def read_powers(text: str, count: int) -> list[float]:
    items = _items(text)
    if len(items) != count or not all(map(NUMBER.fullmatch, items)):
        raise GarbledReply(f"{count} powers", text)
    return [float(item) for item in items]


def read_states(text: str, count: int) -> list[str]:
    items = _items(text)
    if len(items) != count or not all(map(STATE.fullmatch, items)):
        raise GarbledReply(f"{count} port states", text)
    return [item.strip() for item in items]


def _items(text: str) -> list[str]:
    match = LIST.fullmatch(text)
    if match is None:
        raise GarbledReply("values", text)
    return match[1].split(",")


LINE_LIMIT = 1 << 16
MAX_ERRORS = 32  # in the instrument's queue
ERROR_QUERY = ":syst:err?"


class ScpiLink:
    """Requests one after the other; the caller sees to it that they do not overlap.

    A request raises HardwareRefusal if the instrument refuses it, and OSError, EOFError or
    GarbledReply if nothing more can be asked on this connection.
    """

    def __init__(self, host: str, port: int) -> None:
        """Name the instrument's address; nothing is connected yet."""
        self._host, self._port = host, port
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self.identity = ""

    async def open(self) -> None:
        """Connect, unless that is done; forget old errors and learn who answers."""
        if self._streams is None:
            self._streams = await asyncio.open_connection(self._host, self._port, limit=LINE_LIMIT)
            self._write("*CLS")
            self.identity = await self.query("*IDN?")

    async def query(self, text: str) -> str:
        self._write(text, ERROR_QUERY)
        answer = await self._line()
        if is_error(answer):
            await self._refuse(answer, text)
            raise GarbledReply(f"answers to {text}", answer)
        await self._refuse(await self._line(), text)
        return answer

    async def command(self, text: str) -> None:
        """Have something done; return once it is."""
        self._write(text, "*OPC?", ERROR_QUERY)
        done = await self._line()
        if done != "1":
            raise GarbledReply("answers to *OPC?", done)
        await self._refuse(await self._line(), text)

    def drop(self) -> None:
        if self._streams is not None:
            self._streams[1].close()

    async def close(self) -> None:
        """End the connection and wait until it has ended."""
        if self._streams is not None:
            self.drop()
            await asyncio.gather(self._streams[1].wait_closed(), return_exceptions=True)

    async def _refuse(self, line: str, text: str) -> None:
        """Raise HardwareRefusal if a line tells of an error; read those that follow it, too."""
        number, message = read_error(line)
        if number == 0:
            return
        for _ in range(MAX_ERRORS):
            self._write(ERROR_QUERY)
            if read_error(await self._line())[0] == 0:
                raise HardwareRefusal(f"{text}: error {number}, {message}")
        raise GarbledReply("ends of the errors", line)

    def _write(self, *lines: str) -> None:
        assert self._streams is not None
        self._streams[1].write("".join(f"{line}\n" for line in lines).encode("ascii"))

    async def _line(self) -> str:
        assert self._streams is not None
        try:
            line = await self._streams[0].readuntil(b"\n")
        except asyncio.LimitOverrunError as error:
            raise GarbledReply(f"lines of at most {LINE_LIMIT} bytes", "") from error
        try:
            return line.decode("ascii").strip(string.whitespace)
        except UnicodeDecodeError as error:
            raise GarbledReply("ASCII characters", repr(line)) from error
