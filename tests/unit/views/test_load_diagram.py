"""The fibres of a picture of heavy traffic."""

from views.report.load_diagram import MOST_FIBERS, busiest, counted


def test_of_too_many_fibres_those_in_use_longest_are_drawn_by_their_names() -> None:
    """One of no use at all is none of them, nor the two that were in use shortest."""
    number = MOST_FIBERS + 2
    use = {f"f{place:03}": [(0, 1), (5, 5 + place)] for place in range(number)}
    drawn = busiest({**use, "unused": []})
    assert list(drawn) == [f"f{place:03}" for place in range(2, number)]
    assert drawn["f009"] == use["f009"]


def test_sessions_of_one_instant_go_before_others_come() -> None:
    steps = [(1.0, 1), (2.0, 1), (2.0, -1), (3.0, -1)]
    assert counted(steps) == ([1.0, 2.0, 2.0, 3.0], [1, 0, 1, 0])
