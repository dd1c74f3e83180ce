"""The walkthrough, step by step: what is typed prints what the page shows."""

import re
import shlex
from pathlib import Path

import pytest
from conftest import ROOT
from documentation import blocks
from test_documentation import bash

SHELL, PROMPT = "$ ", "qmn> "
BETWEEN = "-- next --"
ANYTHING = "..."


def steps() -> list[tuple[str, list[str]]]:
    """Return every line that is typed, and the lines that follow it."""
    found: list[tuple[str, list[str]]] = []
    for block in blocks("docs/walkthrough.md"):
        for line in block.splitlines():
            if line.startswith((SHELL, PROMPT)):
                found.append((line, []))
            else:
                found[-1][1].append(line)
    return found


STEPS = steps()
SESSION = next(line for line, _shown in STEPS if line.startswith(f"{SHELL}qmn cli"))
BEGINS_SESSION = next(n for n, (line, _shown) in enumerate(STEPS) if line == SESSION)
OF_ONE_RUN = STEPS[:BEGINS_SESSION]
LATER = [step for step in STEPS[BEGINS_SESSION + 1 :] if step[0].startswith(SHELL)]


def pattern(shown: list[str]) -> str:
    """Return what printed text must match: numbers may differ, and blanks; ... is anything."""
    lines = []
    for line in shown:
        parts = [r"\s+".join(map(numbers_apart, part.split())) for part in line.split(ANYTHING)]
        whole = r"\s*[^\n]*\s*".join(parts)
        lines.append(r"(?:[^\n]*\n)*?" if line.strip() == ANYTHING else rf"[ \t]*{whole}[ \t]*\n")
    return "".join(lines)


def numbers_apart(word: str) -> str:
    """Return a pattern for a word in which numbers may be others."""
    return re.sub(r"\d+(?:[.,]\d+)*", r"[\\d.,]+", re.escape(word).replace(r"\.", "."))


def check(typed: str, shown: list[str], printed: str) -> None:
    assert re.fullmatch(pattern(shown), printed), f"{typed} printed\n{printed}"


def test_there_are_twenty_steps() -> None:
    text = (ROOT / "docs" / "walkthrough.md").read_text()
    assert re.findall(r"^\*\*(\d+)\.\*\*", text, re.MULTILINE) == [str(n) for n in range(1, 21)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Where the walkthrough is walked."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    return tmp_path


def walk(folder: Path, typed: str, shown: list[str]) -> None:
    """Type a line to a shell, and compare what it prints."""
    command = typed.removeprefix(SHELL).replace("tshark", f"HOME=/nonexistent {tshark()}")
    ends_badly = any("no key" in line for line in shown)
    check(typed, shown, bash(f"{'! ' if ends_badly else ''}{command} 2>&1", folder))


def test_a_run_and_what_it_has_left_are_as_shown(folder: Path) -> None:
    for typed, shown in OF_ONE_RUN:
        walk(folder, typed, shown)


@pytest.mark.parametrize(("typed", "shown"), LATER, ids=[typed for typed, _shown in LATER])
def test_runs_of_their_own_print_what_is_shown(folder: Path, typed: str, shown: list[str]) -> None:
    walk(folder, typed, shown)


def tshark() -> str:
    """Return how root calls tshark: as another user, who may read root's files."""
    caps = "--inh-caps=+dac_override --ambient-caps=+dac_override"
    return f"setpriv --reuid=65534 --regid=65534 --clear-groups {caps} tshark"


def test_what_is_typed_to_the_network_prints_what_is_shown(folder: Path) -> None:
    said = [(line, shown) for line, shown in STEPS if line.startswith(PROMPT)]
    lines = [line.removeprefix(PROMPT) for line, _shown in said]
    typed = "".join(f"{line}\nsh echo {shlex.quote(BETWEEN)}\n" for line in lines)
    printed = bash(f"{SESSION.removeprefix(SHELL)} 2>&1", folder, typed=typed)
    parts = printed.split(f"{BETWEEN}\n")
    parts[0] = parts[0].partition("\n")[2]  # where the logs are
    assert len(parts) == len(said)
    for (line, shown), part in zip(said, parts, strict=True):
        check(line, shown, part)
