"""The bugs that make mutants puts in: each fits the file as it is, and leaves a program."""

import ast
from collections import Counter
from functools import cache

from bugs import ROOT, Bug, bugs, nearest_tests
from test_structure import PRODUCT, RINGS

LEAST = 0.75  # of the bugs that are due to a room by its lines
MOST_SHARE = 0.1  # that may no longer fit: a rename need not mend them at once


def test_bugs_fit_the_files_as_they_are() -> None:
    gone = [str(bug) for bug in bugs() if not bug.fits(ROOT)]
    print("correct or remove what fits its file no more:", *gone, sep="\n")
    assert len(gone) <= MOST_SHARE * len(bugs())


def test_each_bug_leaves_another_program() -> None:
    for bug in bugs():
        if bug.fits(ROOT):
            text = (ROOT / bug.file).read_text()
            assert dumped(bug.applied(text)) != dumped(text), bug


@cache
def dumped(text: str) -> str:
    return ast.dump(ast.parse(text))


def test_all_rooms_have_bugs_in_proportion_to_their_lines() -> None:
    rooms = *PRODUCT, "qmn", *RINGS, "labs"
    found = Counter(bug.room for bug in bugs())
    lines = {room: sum(count(path) for path in room_files(room)) for room in rooms}
    due = {room: found.total() * lines[room] / sum(lines.values()) for room in rooms}
    short = {room: (found[room], each) for room, each in due.items() if found[room] < LEAST * each}
    assert not short, "bugs that there are, and are due"
    assert found.keys() <= set(rooms)


def room_files(room: str) -> list[str]:
    return [str(path) for path in (ROOT / room).rglob("*.py") if "_pb2" not in path.name]


def count(path: str) -> int:
    with open(path) as file:
        return sum(1 for _ in file)


def test_tests_that_import_a_file_are_found() -> None:
    bug = Bug("wire/lldp.py", "a", "b")
    assert "tests/unit/wire/test_lldp.py" in nearest_tests(bug, ROOT)[0]
