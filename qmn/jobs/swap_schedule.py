"""--schedule NAME: who swaps when in a chain of repeaters, told to the controller by its policy."""

import json
from pathlib import Path

from controller_apps.policy.policy import DEFAULT

POLICY = "policy.toml"  # in the run's folder


def scheduling_policy(schedule: str, folder: Path) -> Path:
    """Write the policy that has the schedule."""
    policy = folder / POLICY
    policy.write_text(DEFAULT.read_text() + f"\n[swap]\nschedule = {json.dumps(schedule)}\n")
    return policy
