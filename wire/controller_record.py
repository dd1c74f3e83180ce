"""The controller's record: one line of JSON for each fact, stamped with the captures' clock."""

import json
import time
from pathlib import Path
from typing import Any

RECORD = "controller.jsonl"
EARLIER = ".1"  # behind the name: what was before, if there has been much


def fact_line(event: str, **fields: Any) -> bytes:
    """Return the line of a fact of this moment."""
    return json.dumps({"time_ns": time.time_ns(), "event": event, **fields}).encode() + b"\n"


def read_record(folder: Path) -> list[dict[str, Any]]:
    """Return the facts that are kept, oldest first; a line still being written is left out."""
    files = (folder / f"{RECORD}{EARLIER}", folder / RECORD)
    text = "".join(file.read_text() for file in files if file.exists())
    return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]
