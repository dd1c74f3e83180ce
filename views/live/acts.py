"""The acts of a live view: each is a command of qmn, whose words come from fields of the page.

The command is run as from another terminal, without a shell, and is noted in the run's folder.
"""

import asyncio
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from qmn.timeouts import LIVE_ACT_S

ACTS = "acts.jsonl"
QMN = (sys.executable, "-m", "qmn")
MOST_BYTES = 4096  # of a field

# The words of each command; those in braces are fields of the page.
VERBS: Mapping[str, str] = {
    "link": "set link {a} {b} {state}",
    "tap": "set tap {a} {b} {fraction}",
    "classical": "set classical {a} {b} {mw}",
    "calibrate": "set calibrate {a} {b}",
    "stuck": "set fault {switch} stuck {in_port} {out_port}",
    "temperature": "set fault {switch} temperature {celsius}",
    "repair": "set fault {switch} repair",
    "set": "set host {host} {setting} {value}",
    "policy": "set policy reload",
    "send": "send {from} {to} {text}",
}


class BadAct(Exception):
    """Something that a page cannot ask for; the text names value and remedy."""


def command_for(value: object) -> list[str]:
    """Return the words of the command that a page asks for; raise BadAct for anything else."""
    match value:
        case {"act": str(name), **fields} if name in VERBS:
            words = VERBS[name].split()
        case {"act": name}:
            raise BadAct(f"unknown act {name!r}: one of {', '.join(VERBS)}")
        case _:
            raise BadAct('an act is an object such as {"act": "repair", "switch": "q1"}')
    names = [word.strip("{}") for word in words if word.startswith("{")]
    if set(fields) != set(names):
        raise BadAct(f"{name} has the fields {', '.join(names) or 'none'}")
    texts = {f"{{{field}}}": _text(fields[field], f"{field} of {name}") for field in names}
    return [texts.get(word, word) for word in words]


def _text(value: object, field: str) -> str:
    if not isinstance(value, str) or not 0 < len(value.encode()) <= MOST_BYTES or "\0" in value:
        raise BadAct(f"{field} is a text of 1 to {MOST_BYTES} bytes")
    if value.startswith("-") and not _is_number(value):
        raise BadAct(f"{field} {value!r} begins as an option")
    return value


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


async def perform(
    words: list[str], folder: Path, now_ns: Callable[[], int]
) -> tuple[int, dict[str, Any]]:
    """Run the command; return its time and its output; note both in the folder."""
    process = await asyncio.create_subprocess_exec(
        *QMN,
        *words,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    try:
        output, _nothing = await asyncio.wait_for(process.communicate(), LIVE_ACT_S)
        text, status = output.decode(errors="replace").strip(), process.returncode
    except TimeoutError:
        process.kill()
        await process.wait()
        text, status = f"no end within {LIVE_ACT_S:g} s", 1
    time_ns = now_ns()
    done = {"command": words, "status": status, "output": text}
    with (folder / ACTS).open("a") as file:
        file.write(json.dumps({"time_ns": time_ns, **done}) + "\n")
    return time_ns, done
