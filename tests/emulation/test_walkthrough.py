"""The walkthrough, step by step: what is typed prints what the page shows."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT
from documentation import blocks, tshark
from test_documentation import bash

SHELL, PROMPT, MININET = "$ ", "qmn> ", "mininet> "
BETWEEN = "-- next --"
ANYTHING = "..."


def steps() -> list[tuple[str, list[str]]]:
    """Return every line that is typed, and the lines that follow it."""
    found: list[tuple[str, list[str]]] = []
    for block in blocks("docs/walkthrough.md"):
        for line in block.splitlines():
            if line.startswith((SHELL, PROMPT, MININET)):
                found.append((line, []))
            else:
                found[-1][1].append(line)
    return found


STEPS = steps()
SESSION = next(line for line, _shown in STEPS if line.startswith(f"{SHELL}qmn cli"))
BEGINS_SESSION = next(n for n, (line, _shown) in enumerate(STEPS) if line == SESSION)
OF_ONE_RUN = STEPS[:BEGINS_SESSION]
# The last step is in Mininet's program, beside a controller; the others are alone.
CONTROLLER = next(n for n, (line, _shown) in enumerate(STEPS) if line.endswith("&"))
LATER = [step for step in STEPS[BEGINS_SESSION + 1 : CONTROLLER] if step[0].startswith(SHELL)]


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
    command = typed.removeprefix(SHELL).replace("tshark", tshark())
    ends_badly = any("no key" in line for line in shown)
    check(typed, shown, bash(f"{'! ' if ends_badly else ''}{command} 2>&1", folder))


def test_a_run_and_what_it_has_left_are_as_shown(folder: Path) -> None:
    for typed, shown in OF_ONE_RUN:
        walk(folder, typed, shown)


@pytest.mark.by_day(every=2)
@pytest.mark.parametrize(("typed", "shown"), LATER, ids=[typed for typed, _shown in LATER])
def test_runs_of_their_own_print_what_is_shown(folder: Path, typed: str, shown: list[str]) -> None:
    walk(folder, typed, shown)


def answered(prompt: str, program: str, folder: Path) -> None:
    """Type to a program what the page types at its prompt, and compare what it prints."""
    texts = [(line, shown) for line, shown in STEPS if line.startswith(prompt)]
    mark = f"sh echo {shlex.quote(BETWEEN)}\n"
    lines = [in_folder(line.removeprefix(prompt), folder) for line, _shown in texts]
    typed = mark + mark.join(f"{line}\n" for line in lines)
    where = ROOT if prompt == MININET else folder
    printed = bash(f"{program} 2>&1", where, typed=typed).replace(prompt, "")
    parts = printed.split(f"{BETWEEN}\n")[1:]  # behind what it says when it starts
    assert len(parts) == len(texts)
    for (line, shown), part in zip(texts, parts, strict=True):
        check(line, shown, part)


def in_folder(line: str, folder: Path) -> str:
    """Return a line that leaves its files in a folder of the test's."""
    return line.replace("/tmp/", f"{folder}/")


def test_what_is_typed_to_the_network_prints_what_is_shown(folder: Path) -> None:
    answered(PROMPT, SESSION.removeprefix(SHELL), folder)


@pytest.mark.usefixtures("machines_open_vswitch")
def test_a_session_over_the_light_of_a_controller_of_ones_own_is_as_shown(folder: Path) -> None:
    controller, network = (
        in_folder(line, folder).removeprefix(SHELL).removeprefix("sudo ")
        for line, _shown in STEPS[CONTROLLER : CONTROLLER + 2]
    )
    program = ["bash", "-c", f"exec {controller.removesuffix('&')}"]
    with (folder / "controller.err").open("w") as errors:
        running = subprocess.Popen(program, cwd=ROOT, stderr=errors)
    try:
        answered(MININET, network, folder)
    finally:
        running.terminate()
        running.wait(10)
