"""The policy of a run, in its folder: the default one, and what options of the run add to it."""

import json
from pathlib import Path

from controller_apps.policy.reading import DEFAULT

POLICY = "policy.toml"  # in the run's folder


def write_policy(folder: Path, more: str = "") -> Path:
    policy = folder / POLICY
    policy.write_text(DEFAULT.read_text() + more)
    return policy


def tapping_policy(begin: str, end: str, by: str, folder: Path) -> Path:
    tap = f"\n[[tap]]\nbetween = {json.dumps((begin, end))}\nby = {json.dumps(by)}\n"
    return write_policy(folder, tap)


def scheduling_policy(schedule: str, rounds: int, folder: Path) -> Path:
    return write_policy(folder, f"\n[swap]\nschedule = {json.dumps(schedule)}\nrounds = {rounds}\n")
