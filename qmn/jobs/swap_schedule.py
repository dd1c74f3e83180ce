"""--schedule NAME: who swaps when in a chain of repeaters, told to the controller by its policy."""

import argparse
import json
from pathlib import Path

from controller_apps.policy.policy import DEFAULT
from controller_apps.policy.schedules import PARALLEL, SCHEDULES
from qmn.network.options import BadInput

POLICY = "policy.toml"  # in the run's folder


def add_option(parser: argparse.ArgumentParser) -> None:
    """Describe the option."""
    text = f"who swaps when ({PARALLEL}, or as --policy says; docs/services.md)"
    parser.add_argument("--schedule", choices=SCHEDULES, default=None, help=text)


def check(arguments: argparse.Namespace) -> None:
    """Raise BadInput if the policy is the user's own."""
    if arguments.schedule is not None and arguments.policy is not None:
        raise BadInput("--schedule makes a policy of its own: write [swap] schedule into --policy")


def make_policy(arguments: argparse.Namespace, folder: Path) -> None:
    """Write the policy that has the schedule, and let it be in force."""
    if arguments.schedule is None:
        return
    arguments.policy = folder / POLICY
    chosen = f"\n[swap]\nschedule = {json.dumps(arguments.schedule)}\n"
    arguments.policy.write_text(DEFAULT.read_text() + chosen)
