"""--schedule NAME, --purify ROUNDS: what repeaters do when, as the controller's policy says."""

import json
from pathlib import Path

from controller_apps.policy.reading import DEFAULT

POLICY = "policy.toml"  # in the run's folder


def scheduling_policy(schedule: str, rounds: int, folder: Path) -> Path:
    """Write the policy that has the schedule, and so many rounds of purification at each level."""
    policy = folder / POLICY
    told = f"\n[swap]\nschedule = {json.dumps(schedule)}\nrounds = {rounds}\n"
    policy.write_text(DEFAULT.read_text() + told)
    return policy
