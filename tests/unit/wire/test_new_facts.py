"""The facts of a record that is being written, each read once."""

from pathlib import Path

from wire.controller_lines import EARLIER, RECORD, NewFacts, fact_line


def numbers(facts: NewFacts) -> list[int]:
    return [fact["number"] for fact in facts.read()]


def append(folder: Path, data: bytes) -> None:
    with (folder / RECORD).open("ab") as file:
        file.write(data)


def test_each_fact_comes_once_and_whole(tmp_path: Path) -> None:
    facts, third = NewFacts(tmp_path), fact_line(1, "x", number=3)
    assert numbers(facts) == []  # there is no file yet
    append(tmp_path, fact_line(1, "x", number=1) + fact_line(1, "x", number=2) + third[:7])
    assert numbers(facts) == [1, 2]
    assert numbers(facts) == []
    append(tmp_path, third[7:])
    assert numbers(facts) == [3]
    facts.close()


def test_what_was_written_last_before_a_new_file_comes_as_well(tmp_path: Path) -> None:
    facts = NewFacts(tmp_path)
    append(tmp_path, fact_line(1, "x", number=1))
    assert numbers(facts) == [1]
    append(tmp_path, fact_line(1, "x", number=2))
    (tmp_path / RECORD).rename(tmp_path / (RECORD + EARLIER))
    append(tmp_path, fact_line(1, "x", number=3))
    assert numbers(facts) == [2, 3]
    facts.close()
