"""The acts of a live view: each is a command of qmn, whose words come from fields of the page.

The command is run as from another terminal, without a shell, and is noted in the run's folder.
"""

import asyncio
import json
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from qmn.timeouts import LIVE_ACT_S

ACTS = "acts.jsonl"
QMN = (sys.executable, "-m", "qmn")
MOST_BYTES = 4096  # of a field
Fields = Mapping[str, str]

# Names of the fields of each, and the words that they make.
VERBS: Mapping[str, tuple[tuple[str, ...], Callable[[Fields], list[str]]]] = {
    "link": (("a", "b", "state"), lambda f: ["link", f["a"], f["b"], f["state"]]),
    "tap": (("a", "b", "fraction"), lambda f: ["tap", f["a"], f["b"], f["fraction"]]),
    "classical": (("a", "b", "mw"), lambda f: ["classical", f["a"], f["b"], f["mw"]]),
    "calibrate": (("a", "b"), lambda f: ["calibrate", f["a"], f["b"]]),
    "stuck": (
        ("switch", "in_port", "out_port"),
        lambda f: ["fault", f["switch"], "stuck", f["in_port"], f["out_port"]],
    ),
    "temperature": (
        ("switch", "celsius"),
        lambda f: ["fault", f["switch"], "temperature", f["celsius"]],
    ),
    "repair": (("switch",), lambda f: ["fault", f["switch"], "repair"]),
    "set": (("host", "setting", "value"), lambda f: ["set", f["host"], f["setting"], f["value"]]),
    "policy": ((), lambda _f: ["policy", "reload"]),
    "send": (("from", "to", "text"), lambda f: ["send", f["from"], f["to"], f["text"]]),
}


class BadAct(Exception):
    """Something that a page cannot ask for; the text names value and remedy."""


def words_of(given: object) -> list[str]:
    """Return the words of the command that a page asks for; raise BadAct for anything else."""
    match given:
        case {"act": str(name), **fields} if name in VERBS:
            wanted, make = VERBS[name]
        case {"act": name}:
            raise BadAct(f"unknown act {name!r}: one of {', '.join(VERBS)}")
        case _:
            raise BadAct('an act is an object such as {"act": "repair", "switch": "q1"}')
    if set(fields) != set(wanted):
        raise BadAct(f"{name} has the fields {', '.join(wanted) or 'none'}")
    texts: dict[str, str] = {}
    for field in wanted:
        value = fields[field]
        if not isinstance(value, str) or not 0 < len(value.encode()) <= MOST_BYTES or "\0" in value:
            raise BadAct(f"{field} of {name} is a text of 1 to {MOST_BYTES} bytes")
        if value.startswith("-") and not _is_number(value):
            raise BadAct(f"{field} {value!r} of {name} begins as an option")
        texts[field] = value
    return make(texts)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


async def perform(words: list[str], folder: Path) -> tuple[int, dict[str, Any]]:
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
    time_ns = time.time_ns()
    done = {"command": words, "status": status, "output": text}
    with (folder / ACTS).open("a") as file:
        file.write(json.dumps({"time_ns": time_ns, **done}) + "\n")
    return time_ns, done
