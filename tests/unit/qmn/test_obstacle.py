"""A run that fails for want of light names the element that the controller found in its way."""

import pytest

from qmn.jobs.obstacle import obstacle

PATH = {"event": "refused", "session": "1", "detail": "PATH_BROKEN: fibre q1-q2 is cut"}
STRANDED = {
    "event": "stranded",
    "session": "1",
    "detail": "cross-connect 3 -> 5 of q1 is stuck: no other way of the same rotation",
}
CUT, STUCK = "fibre bob-q2 (bob-q0) is cut", "cross-connect 3 -> 5 of q1 is stuck"
ENDED = {"event": "torn_down", "session": "1", "detail": "FIN"}


@pytest.mark.parametrize(
    ("record", "elements"),
    [
        ([], ""),
        ([PATH], "fibre q1-q2 is cut"),
        ([PATH | {"detail": f"FIBER_CUT: {CUT}"}], CUT),
        ([PATH | {"detail": "BUSY"}], ""),
        ([STRANDED, ENDED], STUCK),
        ([STRANDED, {"event": "moved", "session": "1"}], ""),
        ([STRANDED, {"event": "port", "at": 3, "up": True}], ""),
        ([STRANDED, {"event": "port", "at": 3, "up": False}], STUCK),
        ([STRANDED, {"event": "granted", "session": "1"}, ENDED], STUCK),
        ([STRANDED, ENDED, {"event": "granted", "session": "2"}], ""),
        ([PATH, {"event": "granted", "session": "2"}], ""),
        ([PATH, PATH | {"detail": "BUSY", "session": "2"}], ""),
    ],
)
def test_the_last_one_counts(record: list[dict[str, object]], elements: str) -> None:
    assert obstacle(record) == elements
