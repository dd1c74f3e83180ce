"""Every `qmn` command of docs, run as it stands there: it ends as its page says, in minutes.

Those of the README and the walkthrough, with their outputs, are in tests/emulation.
"""

import os
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from documentation import NAMES, ROOT, blocks, shell

pytestmark = pytest.mark.timeout(3600)

ELSEWHERE = ("README.md", "docs/walkthrough.md")
OF_A_NETWORK_THAT_RUNS = (
    *("devices", "paths", "keys", "set", "policy", "fault"),
    *("calibrate", "classical", "tap", "link", "send"),
)
OF_A_NETWORK_OR_A_RUN = ("spy", "live")
UNTIL_CTRL_C = re.compile(r"qmn (live|spy(?! runs)|run keys(?!.*--seconds))")
SECONDS = 20  # of these
# Others run them: tests/unit/qmn/test_pages.py with the file that they need, and
# tests/emulation/test_sabot.py beside the program that they need.
SHOWN_TO_WORK = ("bell.qasm", "--sabot")
PLACEHOLDERS = {"COPY": "copy", "RUN": "runs/first"}
ELSEWHERE_ONLY = re.compile(r"qmn runs(?= import)")  # what is here cannot be imported


@dataclass(frozen=True)
class Typed:
    """A line of a page."""

    page: str
    line: str
    before: tuple[str, ...]  # variables that its block sets

    @property
    def verb(self) -> str:
        """Return the word behind `qmn`."""
        return self.line.split()[1]

    @property
    def needs_network(self) -> bool:
        """Whether a network has to run."""
        of_both = self.verb in OF_A_NETWORK_OR_A_RUN and "runs/" not in self.line
        return self.verb in OF_A_NETWORK_THAT_RUNS or of_both


def typed(page: str) -> Iterator[Typed]:
    """Yield the lines of a page that call `qmn`."""
    for block in blocks(page):
        before: list[str] = []
        for line in block.replace("\\\n", " ").splitlines():
            line = re.sub(r"^sudo bin/", "", line)
            if re.match(r"[a-z]+=", line):
                before.append(line.replace(".venv/bin/python", str(ROOT / ".venv/bin/python")))
            elif line.startswith("qmn ") and not any(each in line for each in SHOWN_TO_WORK):
                yield Typed(page, line, tuple(before))


LINES = [each for page in NAMES if page not in ELSEWHERE for each in typed(page)]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where a reader works, who has had runs before."""
    made = tmp_path_factory.mktemp("work")
    (made / "examples").symlink_to(ROOT / "examples")
    (made / "big.bin").write_bytes(bytes(100_000))
    (made / "commands.txt").write_text("alice qsend bob hello\n")
    for _run in range(2):
        done = shell("qmn run sdc --depolarizing 0.001 --frame-bytes 32 --qasm", made)
        assert done.returncode == 0, done.stderr
    first = min((made / "runs").glob("2*"))
    (made / "runs" / "first").symlink_to(first.name)
    return made


@pytest.fixture
def network(folder: Path) -> Iterator[None]:
    """Have a network that runs."""
    command = ["qmn", "cli", "sdc", "--capture", "--runs", str(folder / "others")]
    pipe = subprocess.PIPE
    path = f"{ROOT / 'bin'}:{os.environ['PATH']}"
    with subprocess.Popen(
        command, stdin=pipe, stdout=pipe, text=True, env={**os.environ, "PATH": path}
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("alice qsend bob hello\n")
        process.stdin.flush()
        assert any("bob: hello" in line for line in process.stdout)
        yield
        process.stdin.write("exit\n")
        process.stdin.close()
        process.stdout.read()


@pytest.mark.parametrize("command", LINES, ids=lambda each: f"{each.page}: {each.line}")
def test_a_command_of_a_page_ends_as_it_says(
    folder: Path, command: Typed, request: pytest.FixtureRequest
) -> None:
    if command.needs_network:
        request.getfixturevalue("network")
    line = re.sub(r"\b(COPY|RUN)\b", lambda found: PLACEHOLDERS[found[0]], command.line)
    line = ELSEWHERE_ONLY.sub("qmn runs --runs elsewhere", line)
    if UNTIL_CTRL_C.match(line):
        line = f"timeout --preserve-status --signal=INT {SECONDS} {line}"
    done = shell("\n".join([*command.before, line]), folder, typed="exit\n")
    statuses = {0}
    if UNTIL_CTRL_C.match(command.line):
        statuses = {0, 130}
    elif "no key" in command.line.partition("#")[2]:
        statuses = {1}
    assert done.returncode in statuses, done.stdout[-3000:] + done.stderr[-3000:]
    assert "Traceback" not in done.stdout + done.stderr
