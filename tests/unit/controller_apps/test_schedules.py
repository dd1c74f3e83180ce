"""The order of swaps: every repeater once, as its scheme says."""

from math import ceil, log2

import pytest

from controller_apps.policy.schedules import SCHEDULES, Schedule, Turn, schedule


def rounds(turns: Schedule) -> dict[int, int]:
    """Return in which round each repeater swaps; raise RecursionError if some wait for ever."""

    def of(place: int) -> int:
        turn = turns[place]
        waits = [of(other) for other in (turn.after_left, turn.after_right) if other]
        return 1 + max(waits, default=0)

    return {place: of(place) for place in turns}


@pytest.mark.by_day(every=3)
@pytest.mark.parametrize("name", SCHEDULES)
@pytest.mark.parametrize("repeaters", range(1, 17))
def test_every_repeater_has_a_turn_after_others_on_its_two_sides(name: str, repeaters: int) -> None:
    turns = schedule(name, repeaters)
    assert sorted(turns) == list(range(1, repeaters + 1))
    for place, turn in turns.items():
        assert 0 <= turn.after_left < place
        assert turn.after_right == 0 or place < turn.after_right <= repeaters
    assert rounds(turns).keys() == turns.keys()


def test_in_parallel_nobody_waits() -> None:
    assert set(schedule("parallel", 5).values()) == {Turn()}


def test_from_left_to_right_each_waits_for_the_one_before() -> None:
    assert rounds(schedule("left-to-right", 5)) == {1: 1, 2: 2, 3: 3, 4: 4, 5: 5}


def test_seven_repeaters_nest_as_in_the_paper() -> None:
    """Eight links: those at the odd places swap first, then 2 and 6, then 4."""
    assert rounds(schedule("nested", 7)) == {1: 1, 2: 2, 3: 1, 4: 3, 5: 1, 6: 2, 7: 1}
    assert schedule("nested", 7)[4] == Turn(after_left=2, after_right=6)


@pytest.mark.parametrize("repeaters", range(1, 17))
def test_nesting_takes_as_many_rounds_as_the_links_can_be_halved(repeaters: int) -> None:
    assert max(rounds(schedule("nested", repeaters)).values()) == ceil(log2(repeaters + 1))
