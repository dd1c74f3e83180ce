"""Replies of a matrix switch, read strictly: anything else is a GarbledReply.

connections  (@1,2),(@17,18)   ingress ports, then the egress port of each; none: (@),(@)
errors       -222,"Data out of range"      0,"No error"
powers       (-10.53,-60.00)   dBm
port states  (E,E,F)           enabled, disabled (D), failed
"""

import re
from collections.abc import Iterable, Mapping

# ASCII: what float() takes for a space, or for a digit, and nothing more.
CONNECTIONS = re.compile(r"\(@([\d, ]*)\),\s*\(@([\d, ]*)\)", re.ASCII)
ERROR = re.compile(r'([+-]?\d{1,6}),\s*"([ -~]*)"', re.ASCII)
LIST = re.compile(r"\(([^()]*)\)")
NUMBER = re.compile(r"\s*[+-]?\d{1,4}(\.\d{1,9})?([eE][+-]?\d)?\s*", re.ASCII)
STATE = re.compile(r"\s*([EDF])\s*", re.ASCII)


class GarbledReply(ValueError):
    """The instrument said what it never should; the message quotes it."""

    def __init__(self, what: str, text: str) -> None:
        shown = text if len(text) <= 60 else f"{text[:60]}..."
        super().__init__(f"{shown!r} are not {what}")


def channels(ports: Iterable[int]) -> str:
    return f"(@{','.join(map(str, ports))})"


def pairs(connections: Mapping[int, int]) -> str:
    """Return connections (ingress to egress) as two channel lists."""
    return f"{channels(connections)},{channels(connections.values())}"


def read_connections(text: str) -> dict[int, int]:
    """Return the connections, ingress to egress."""
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
