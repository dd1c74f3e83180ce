"""Wireshark's fields of tallies: coin.lua reads `tables()` as `formats.coin`."""

from pathlib import Path

from coin.tally import FIELDS, TOPIC

LUA = Path(__file__).with_name("coin.lua")


def tables() -> dict[str, int]:
    return {"topic": TOPIC, "size": FIELDS.size}
