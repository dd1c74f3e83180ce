"""Lines of JSON that applications of hosts print, and who follows them reads."""

import json
from typing import Any


def fields_of(line: str | bytes) -> dict[str, Any]:
    """Return the object of a line, {} for a line that is not one: the interpreter also warns."""
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return fields if isinstance(fields, dict) else {}
