"""The controller's record stays bounded, and what is kept is whole."""

from pathlib import Path

import pytest

from controller_apps.record import Record
from wire.controller_lines import RECORD, read_record


@pytest.mark.parametrize("facts_of_one", [2_000, 77])
def test_a_flood_of_facts_keeps_the_newest(tmp_path: Path, facts_of_one: int) -> None:
    for number in range(2_000):
        if number % facts_of_one == 0:  # a controller, or its successor
            record = Record(str(tmp_path / RECORD), most_bytes=10_000)
        record.write("refused", number=number)
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) <= 2 * 10_000
    numbers = [fact["number"] for fact in read_record(tmp_path)]
    assert numbers == [*range(numbers[0], 2_000)]
    assert len(numbers) > 100  # of lines of some 70 bytes


def test_a_successor_goes_on_with_the_record(tmp_path: Path) -> None:
    for number in range(3):
        Record(str(tmp_path / RECORD)).write("began", number=number)
    assert [fact["number"] for fact in read_record(tmp_path)] == [0, 1, 2]
