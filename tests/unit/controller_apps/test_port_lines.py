"""Lines of the controller's log about a flood: a share of each port, and how many were left out."""

import logging

import pytest

from controller_apps.light.optics import SwitchPort
from controller_apps.record import PortLines

FLOODED, OTHER = SwitchPort(1, 3), SwitchPort(1, 4)


@pytest.fixture
def lines(caplog: pytest.LogCaptureFixture) -> PortLines:
    caplog.set_level(logging.INFO, logger="c0")
    return PortLines(logging.getLogger("c0"))


def test_a_port_has_five_lines_in_a_second_and_keeps_no_other_from_its_own(
    lines: PortLines, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(1000):
        lines.add(FLOODED, f"flood {number}", number / 1001)
    lines.add(OTHER, "of another", 0.999)
    assert caplog.messages == [*(f"flood {number}" for number in range(5)), "of another"]


def test_how_many_lines_were_left_out_is_said_when_the_second_is_over(
    lines: PortLines, caplog: pytest.LogCaptureFixture
) -> None:
    for number in range(12):
        lines.add(FLOODED, f"flood {number}", 10.0)
    lines.add(OTHER, "of another", 10.5)
    lines.time_passed(10.99)
    assert caplog.messages[5:] == ["of another"]
    lines.time_passed(11.0)
    more = "switch 0x1 port 3: 7 more lines, which are left out"
    assert caplog.messages[6:] == [more]
    lines.add(FLOODED, "later", 11.1)
    assert caplog.messages[7:] == ["later"]


def test_it_is_also_said_where_nobody_tells_the_time(
    lines: PortLines, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(7):
        lines.add(FLOODED, "flood", 0.0)
    lines.add(FLOODED, "later", 1.0)
    assert caplog.messages[5].endswith("port 3: 2 more lines, which are left out")
    assert caplog.messages[6:] == ["later"]
