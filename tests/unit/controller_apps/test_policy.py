"""Policy files: what they allow, and what is wrong with those that cannot be used."""

from dataclasses import replace
from pathlib import Path

import pytest

from controller_apps.policy.policy import Host, Policy, Reporting, SessionRequest
from controller_apps.policy.reading import (
    SHIPPED,
    BadPolicy,
    parse_policy,
    read_policy,
    require_network,
)
from controller_apps.policy.schedules import Queue
from qmn.network.description import describe_network
from qmn.network.options import NetworkOptions
from wire.device import DeviceSettings

ALICE, BOB, CHARLIE = (
    Host(name, f"10.0.0.{number}") for number, name in enumerate(("alice", "bob", "charlie"), 1)
)
REQUEST = SessionRequest("sdc", ALICE, BOB, CHARLIE, 1_000_000, 4096, 256)
BACK = replace(REQUEST, sender=BOB, receiver=ALICE)


def test_the_default_policy_allows_the_demo() -> None:
    policy = read_policy("")
    assert policy.objection(REQUEST, []) == policy.objection(BACK, []) == ""


def test_the_example_denies_all_but_alice_to_bob() -> None:
    policy = read_policy(SHIPPED / "deny.toml")
    assert policy.objection(REQUEST, []) == ""
    assert policy.objection(BACK, []) == "no rule allows it, and the default denies"
    assert policy.objection(replace(REQUEST, source=ALICE), []) != ""
    assert policy.objection(REQUEST, [REQUEST]) == (
        "rule 1: max_sessions is 1, and as many are open"
    )


def test_the_first_rule_that_fits_decides() -> None:
    policy = parse_policy("""
        [[rule]]
        action = "allow"
        from = "10.0.0.1"
        to = "bob"
        [[rule]]
        action = "deny"
        service = "sdc"
    """)
    assert policy.objection(REQUEST, []) == ""
    assert policy.objection(BACK, []) == "rule 2 denies it"


@pytest.mark.parametrize(
    ("limit", "text"),
    [
        ("max_rate_hz = 999999", "max_rate_hz is 999999, asked for is 1000000"),
        ("max_block_pairs = 4095", "max_block_pairs is 4095, asked for is 4096"),
        ("max_frame_bytes = 255", "max_frame_bytes is 255, asked for is 256"),
        ("min_frame_bytes = 257", "min_frame_bytes is 257, asked for is 256"),
    ],
)
def test_a_limit_is_kept_to_the_last_unit(limit: str, text: str) -> None:
    name, _, value = limit.partition(" = ")
    policy = parse_policy(f'[[rule]]\naction = "allow"\n{limit}')
    assert policy.objection(REQUEST, []) == f"rule 1: {text}"
    edge = int(value) + (-1 if name.startswith("min") else 1)
    assert parse_policy(f'[[rule]]\naction = "allow"\n{name} = {edge}').objection(REQUEST, []) == ""


def test_sessions_count_against_the_rule_that_allowed_them() -> None:
    policy = parse_policy("""
        [[rule]]
        action = "allow"
        from = "alice"
        max_sessions = 2
        [[rule]]
        action = "allow"
        max_sessions = 1
    """)
    assert policy.objection(REQUEST, [BACK, REQUEST]) == ""
    assert policy.objection(REQUEST, [REQUEST, REQUEST]).startswith("rule 1: max_sessions is 2")
    assert policy.objection(BACK, [REQUEST, REQUEST]) == ""


def test_overrides_and_reporting_are_read() -> None:
    policy = parse_policy("""
        [device.alice]
        rate_hz = 1_000_000
        fec = "golay"
        interleave = true
        [swap]
        schedule = "nested"
        [report]
        period_s = 2
        lost_share = 0.5
    """)
    assert policy == Policy(
        devices={"alice": DeviceSettings(rate_hz=1_000_000, fec=3, interleave=1)},
        reporting=Reporting(2.0, 0.5, 1.0),
        schedule="nested",
    )
    assert parse_policy("").schedule == "parallel"
    slots = parse_policy('[queue]\norder = "slots"\nslot_s = 0.25\n')
    assert slots.queue == Queue("slots", 0.25)
    assert parse_policy("").queue == Queue("fcfs", 0.5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("default = 'maybe'", "default 'maybe': choose one of allow, deny"),
        ('[default]\naction = "no"', 'default is a table: write default = "allow", or one of deny'),
        ("[queue.order]", 'queue: order is a table: write order = "fcfs", or one of edf, slots'),
        ("[[rule]]\nfrom = 'a'", "rule 1 has no action"),
        ("[[rule]]\naction = 'allow'\n[[rule]]\naction = 'no'", "rule 2: action 'no'"),
        ("[[rule]]\naction = 'deny'\nservice = 'ftp'", "service 'ftp': choose one of *, sdc"),
        ("[[rule]]\naction = 'deny'\nfrom = 7", "rule 1: from is 7: a host"),
        ("[[rule]]\naction = 'deny'\nform = 'alice'", "rule 1 has no form: did you mean from"),
        ("[[rule]]\naction = 'deny'\nmax_sessions = 1", "rule 1 denies and has limits"),
        ("[[rule]]\naction = 'allow'\nmax_sessions = 0", "max_sessions 0: choose 1 to 4096"),
        ("[[rule]]\naction = 'allow'\nmax_rate_hz = true", "max_rate_hz True"),
        ("[rule]\naction = 'allow'", "rule is {'action': 'allow'}: write it as [[rule]]"),
        ("[device.bob]\nrate_hz = 0", "device bob: rate_hz 0: choose 1 to"),
        ("[device.bob]\nspeed = 0", "device bob has no speed"),
        ("[report]\nperiod_s = 0.01", "report: period_s 0.01: choose 0.1 to 3600"),
        ("[report]\nlost_share = 1.5", "lost_share 1.5: choose 0 to 1"),
        ("[tap]\nby = 'eve'", "tap is {'by': 'eve'}: write it as [[tap]]"),
        ("[[trusted]]", "trusted 1: host is None: a host"),
        ("[[trusted]]\nhost = 'r'\nbetween = ['a']", "trusted 1: between is ['a']: write between"),
        ("[[trusted]]\nhost = 'a'\nbetween = ['a', 'b']", "host 'a' is one of between"),
        ("[[trusted]]\nhost = 'r'\nkeys = 1", "trusted 1 has no keys"),
        ("[[tap]]\nby = 'eve'", 'tap 1: between is None: write between = ["alice", "bob"]'),
        ("[[tap]]\nbetween = ['a']\nby = 'e'", "tap 1: between is ['a']: write between"),
        ("[[tap]]\nbetween = ['a', 7]\nby = 'e'", "between is ['a', 7] and by is 'e': write"),
        ("[[tap]]\nbetween = ['a', 'b']", "and by is None: write between"),
        ("[[tap]]\nbetween = ['a', 'b']\nby = 'a'", "by is 'a': write between"),
        ("[[tap]]\nbetween = ['a', 'b']\nby = 'e'\non = 1", "tap 1 has no on"),
        (
            "[[tap]]\nbetween = ['a', 'b']\nby = 'e'\n[[tap]]\nbetween = ['b', 'a']\nby = 'f'",
            "tap 2: there is a tap between a and b already; keep one of them",
        ),
        ("[swap]\nschedule = 'all'", "swap: schedule 'all': choose one of parallel, left-to"),
        ("[filter]\naddresses = 1", "filter: addresses is 1: true or false"),
        ("[filter]\nnames = true", "filter has no names"),
        ("[queue]\norder = 'lifo'", "queue: order 'lifo': choose one of fcfs, edf, slots"),
        ("[queue]\nslot_s = 1", "queue: slot_s is of order = \"slots\", not of 'fcfs'"),
        ("[queue]\norder = 'slots'\nslot_s = 0.01", "queue: slot_s 0.01: choose 0.05 to 60"),
        (
            "[swap]\norder = 'all'",
            "swap has no order: choose one of purification, rounds",
        ),
        ("[[rule]]\naction = 'deny'\nservice = 'link'", "service 'link': choose one of *"),
        ("defualt = 'deny'", "a policy has no defualt"),
        ("metadata_at_switch = 'seen'", "metadata_at_switch 'seen': choose one of required"),
        ("default = deny", "is not TOML: Invalid value (at line 1, column 11)"),
    ],
)
def test_a_bad_file_is_named_with_place_value_and_remedy(
    tmp_path: Path, text: str, words: str
) -> None:
    file = tmp_path / "policy.toml"
    file.write_text(text)
    with pytest.raises(BadPolicy) as caught:
        read_policy(file)
    assert str(file) in str(caught.value)
    assert words in str(caught.value)


def test_a_file_that_is_not_there_or_not_text_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadPolicy, match="No such file"):
        read_policy(tmp_path / "none.toml")
    (tmp_path / "binary").write_bytes(b"\xff\xfe")
    with pytest.raises(BadPolicy, match="binary"):
        read_policy(tmp_path / "binary")


def test_a_policy_has_its_network_laid_for_copies_of_setups_or_is_refused(tmp_path: Path) -> None:
    """Its word goes before the option's; a network that stands is not laid again."""
    file = tmp_path / "policy.toml"
    file.write_text('metadata_at_switch = "required"\n')
    policy = read_policy(file)
    options = NetworkOptions(topology="sdc", policy=str(file), metadata_at_switch="off")
    assert describe_network(options).options.metadata_at_switch == "required"
    require_network(policy, ["q1"], "required")
    require_network(parse_policy(""), ["q1"], "off")
    with pytest.raises(BadPolicy, match="this network is laid for observed: start one with"):
        require_network(policy, ["q1"], "observed")
