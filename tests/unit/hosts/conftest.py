"""The part that all tests of stacks share: light that is drawn alike in each process."""

from ipaddress import IPv4Address

import pytest

from hosts import stack
from wire.metadata import session_number


@pytest.fixture(autouse=True)
def _same_light_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have light drawn alike in all processes: it is drawn by session, whose number has an address.

    Hosts of tests have others in each process, of which the last byte is always the same.
    """

    def number(opener: str, count: int) -> int:
        last = IPv4Address(opener).packed[3]
        return session_number(f"127.0.0.{last}", count)

    monkeypatch.setattr(stack, "session_number", number)
