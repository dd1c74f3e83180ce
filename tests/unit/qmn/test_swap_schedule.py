"""What `--schedule` asks for: a policy in which the controller finds it."""

import argparse
from pathlib import Path

import pytest

from controller_apps.policy.policy import DEFAULT, read_policy
from controller_apps.policy.schedules import SCHEDULES
from qmn.jobs import swap_schedule
from qmn.jobs.service import add_parsers, check_input
from qmn.network.options import BadInput


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_parsers(parser.add_subparsers())
    return parser.parse_args(words)


@pytest.mark.parametrize("name", SCHEDULES)
def test_the_controller_reads_it_beside_what_the_default_policy_says(
    tmp_path: Path, name: str
) -> None:
    arguments = parse("swap", "--schedule", name)
    check_input(arguments)
    swap_schedule.make_policy(arguments, tmp_path)
    policy = read_policy(arguments.policy)
    assert policy.schedule == name
    assert policy.reporting == read_policy(DEFAULT).reporting


def test_without_it_no_policy_is_made(tmp_path: Path) -> None:
    arguments = parse("swap")
    check_input(arguments)
    swap_schedule.make_policy(arguments, tmp_path)
    assert arguments.policy is None
    assert list(tmp_path.iterdir()) == []


def test_it_and_a_policy_of_the_users_own_are_refused() -> None:
    arguments = parse("swap", "--schedule", "nested", "--policy", str(DEFAULT))
    with pytest.raises(BadInput, match=r"write \[swap\] schedule into --policy"):
        check_input(arguments)


def test_only_swaps_have_turns() -> None:
    with pytest.raises(SystemExit):
        parse("distribute", "--schedule", "nested")
