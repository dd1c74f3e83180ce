"""The session that gave back the light for which another has waited."""

import pytest

from controller_apps.light.paths import Direction
from controller_apps.sessions.holders import Holders

IN, OUT = Direction(1, 2, True), Direction(1, 3, False)
ENDS = ("10.0.0.1", "10.0.0.2")
GREEN, RED = 193_100_000, 193_200_000  # MHz


def given_back(*lines: tuple[list[Direction], int, int]) -> Holders:
    """Return the holders after sessions have given light back, in order."""
    holders = Holders()
    for ways, session, frequency in lines:
        holders.gave_back(ways, session, ENDS, frequency)
    return holders


@pytest.mark.parametrize(
    ("holders", "since", "last"),
    [
        (given_back(([IN], 7, GREEN), ([OUT], 8, GREEN)), 0, 8),  # until the last of both is free
        (given_back(([OUT], 8, GREEN), ([IN], 7, GREEN)), 0, 7),
        (given_back(([IN], 7, GREEN), ([OUT], 8, GREEN)), 1, 8),
        (given_back(([IN], 7, GREEN), ([OUT], 8, GREEN)), 2, None),  # both before it had to wait
        (given_back(([IN], 7, GREEN), ([OUT], 9, GREEN)), 0, 7),  # 9 is the one that asks
        (given_back(([IN], 7, GREEN), ([IN], 8, GREEN)), 0, 8),
        (given_back(([IN.opposite], 7, GREEN)), 0, None),  # light in both directions is no matter
        (given_back(([IN.opposite], 7, RED)), 0, 7),  # but a port has one tuning
        (given_back(), 0, None),
    ],
)
def test_the_last_of_the_others_who_gave_light_back_meanwhile_was_waited_for(
    holders: Holders, since: int, last: int | None
) -> None:
    found = holders.last([IN, OUT], 9, GREEN, since)
    assert (found.session if found else None) == last
