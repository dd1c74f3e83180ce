"""The documentation as tests read it: its pages, their blocks, and the commands in these."""

import os
import re
import shlex
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
PAGES += [ROOT / folder / "README.md" for folder in ("docker", "examples")]
PAGES += sorted((ROOT / "labs").glob("*/README.md"))
PAGES += sorted((ROOT / "course").glob("*.md"))
PAGES = [page for page in PAGES if page.name != "CHANGELOG.md"]
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
ENDS_COMMAND = {"|", "<", ">", "&", "&&"}


def blocks(page: str, language: str = "") -> list[str]:
    """Return the blocks of a page that are of a language, as marked."""
    text = (ROOT / page).read_text()
    return [body for marked, body in FENCE.findall(text) if marked == language]


def commands(page: str, program: str) -> list[list[str]]:
    """Return how a page calls a program: the words behind it, of each line that begins so."""
    found = []
    for block in blocks(page):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True) if line.startswith(f"{program} ") else []
            end = next((i for i, word in enumerate(words) if word in ENDS_COMMAND), len(words))
            found += [words[1:end]] if words else []
    return found


def shell(
    text: str, cwd: Path, typed: str = "", timeout_s: float | None = None
) -> "subprocess.CompletedProcess[str]":
    """Type text to a shell in a folder where `qmn` is on the PATH; it ends at the first error."""
    return subprocess.run(
        ["bash", "-ec", text],
        cwd=cwd,
        env={**os.environ, "PATH": f"{ROOT / 'bin'}:{os.environ['PATH']}"},
        input=typed,
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout_s,
    )


def tshark() -> str:
    """Return how root calls tshark: as another user, who may read root's files."""
    caps = "--inh-caps=+dac_override --ambient-caps=+dac_override"
    return f"HOME=/nonexistent setpriv --reuid=65534 --regid=65534 --clear-groups {caps} tshark"


def without_numbers(text: str) -> str:
    """Return text without what differs from run to run: numbers, folders, blanks at ends."""
    text = re.sub(r"\S*/runs/[\w-]+|/home/you/qmn", "FOLDER", text)
    text = re.sub(r"\d[\d.,]*|\b\de-\d+\b", "N", text)
    text = re.sub(r"━+", "━", text)
    return "\n".join(line.rstrip() for line in text.strip().splitlines())
