"""Sessions of key distribution with noise, between whole stacks with a real dispatcher.

A thousand, of the protocol alone, are in qkd/test_qkd_sessions.py.
"""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from fault_scene import running, session

from hosts import network_loop

SESSIONS = 6  # of each protocol, noise and correction
NOISES = (0.002, 0.005, 0.015, 0.025)  # depolarising of each fibre
KEY_BITS = 256  # of a key in a store
Keys = dict[str, bytes]


def stored(folder: Path, host: str, other: str) -> dict[str, Keys]:
    """Return the keys in a host's store by id, and by who hands them out first."""
    place = folder / "keys" / host / other
    return {
        part: {file.name: file.read_bytes() for file in (place / part).iterdir()}
        for part in ("first", "second")
    }


@pytest.mark.by_day(every=4)
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("protocol", ["bb84", "bbm92"])
def test_both_stores_hold_the_same_keys_after_every_session(
    tmp_path: Path, protocol: str, noise: float
) -> None:
    async def run() -> None:
        delivered = 0
        async with running(tmp_path, protocol, depolarizing=noise):
            for number in range(SESSIONS):
                correction = ("cascade", "ldpc")[number % 2]
                options: dict[str, Any] = {
                    "count": 4000,
                    "block_pairs": 4500,
                    "correction": correction,
                }
                alice, bob = await asyncio.to_thread(session, tmp_path, protocol, **options)
                assert bool(alice.text) == bool(bob.text)
                delivered += not alice.text
                if not alice.text:
                    assert alice.summary["sifted_bits"] == bob.summary["sifted_bits"] >= 4000
                    whole = alice.summary["key_bits"] // KEY_BITS  # chance may leave less than one
                    assert alice.summary["keys"] == bob.summary["keys"] == whole
                mine, theirs = (
                    stored(tmp_path, "alice", "bob"),
                    stored(tmp_path, "bob", "alice"),
                )
                assert mine["first"] == theirs["second"]
                assert mine["second"] == theirs["first"]
        assert delivered >= 0.8 * SESSIONS
        assert len(mine["first"]) >= delivered

    network_loop.run(run())
