"""A policy file in TOML: permissions of sessions between hosts, and settings of devices.

default = "deny"            # or "allow": where no rule fits
metadata_at_switch = "required"  # as the option --metadata-at-switch, which it goes before

[[rule]]                    # tried in order, the first that fits decides
action = "allow"
service = "sdc"             # left out, or "*": any
from = "alice"              # a host's name, its address, or "*"
to = "bob"
source = "charlie"
max_sessions = 2            # limits, of rules that allow
max_rate_hz = 1_000_000
max_block_pairs = 65_536
min_frame_bytes = 16
max_frame_bytes = 1024

[[tap]]                     # light between these two, either way, goes by way of a third host
between = ["alice", "bob"]
by = "eve"

[[closed]]                  # no session has light through the fibres between these two switches
between = ["q1", "q2"]

[[watch]]                   # the way between these two is watched while no session has its light:
between = ["alice", "bob"]  # pairs are made by the first
over = ["q1", "q2"]         # the fibre that is to be on the way; left out: by any way that is idle
every_s = 10.0              # of the network, from the end of one link monitor to the next
pairs = 2000                # compared by each
rate_hz = 100_000           # pairs a second
whole_error = 0.01          # of these differ at most without an intruder
fraction = 0.25             # of the photons that an intruder to be found measures
false_alarm = 1e-6          # of a test, at most
missed = 0.01               # chance at most that a test takes such an intruder for nobody

[seal]                      # when a link monitor finds an eavesdropper,
alarm = "close"             # that is closed until the policy is read again; "tell": it is not

[[trusted]]                 # a host that may relay keys of others, and so may know them
host = "r1"                 # "*": every host
between = ["alice", "bob"]  # left out: of any two

[swap]
schedule = "parallel"       # who swaps when, or "left-to-right", "nested": see policy.schedules
purification = "dejmps"     # or "bbpssw": what is done to pairs before they are swapped,
rounds = 0                  # so often: of links, and of what swaps make

[queue]
order = "fcfs"              # who waits gets light in this order, or "edf", "slots": policy.orders
slot_s = 0.5                # of "slots": how long light is handed out for, in time of the network

[filter]                    # against hosts that pose as others; for attack studies it can be off
addresses = true            # switches drop what is not from the port's own MAC or IPv4 address
handshakes = true           # a set-up needs a TCP connection that both ends have opened
sequences = true            # a FIN or RST counts only where its connection is
announcements = true        # LLDP in the name of a host needs that host's seal
numbers = true              # a session has a number of its opener, not of another host

[refusal]
names_elements = true       # refusals name the fibre, cross-connect or switch

[device.alice]              # overrides what applications on alice ask for
rate_hz = 1_000_000
fec = "golay"               # or its number, as in wire.metadata.vocabulary.Fec
interleave = true
cutoff_us = 5000            # its memory drops what is older
compensate_s = 60           # its polarisation compensator looks at its reference so often

[report]                    # when devices tell their state: see wire.device.Subscribe
period_s = 1.0
"""

import tomllib
from collections.abc import Collection
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from controller_apps.policy.policy import (
    ALARMS,
    MAX_WATCHES,
    RANGES,
    TELL,
    WHO,
    Filter,
    Policy,
    Reporting,
    Rule,
    Tap,
    Trusted,
    Watch,
)
from controller_apps.policy.schedules import (
    ORDERS,
    PARALLEL,
    PROTOCOLS,
    SCHEDULES,
    SLOTS,
    UNPURIFIED,
    Purification,
    Queue,
)
from wire.device import (
    MAX_LEVEL_ROUNDS,
    MAX_SHARE,
    PERIODS_S,
    DeviceSettings,
    check_settings,
    setting_number,
)
from wire.parameters.checks import check_choice, check_names, check_number, remedy
from wire.parameters.network import OBSERVED, OFF, REQUIRED
from wire.registered import Registry
from wire.services import LIGHT, RETURNS

SHIPPED = Path(__file__).parent
DEFAULT = SHIPPED / "demo.toml"
POLICIES = Registry(
    "qmn.policies", lambda each: isinstance(each, Path), {"deny": SHIPPED / "deny.toml"}
)
ACTIONS = ("allow", "deny")
# A return is allowed as what it is a return of.
SERVICES = ("*", *(service.name.lower() for service in LIGHT if service not in RETURNS))
LIMITS = {
    "max_sessions": (1, 4096),
    "max_rate_hz": (1, 4_000_000_000),
    "max_block_pairs": (1, 1 << 18),
    "min_frame_bytes": (1, 1 << 16),
    "max_frame_bytes": (1, 1 << 16),
}
MAX_RULES = 1024
MAX_TAPS = 64
SLOT_S = (0.05, 60.0)
MAX_CLOSED = 256
MAX_TRUSTED = 256

T = TypeVar("T")


class BadPolicy(ValueError):
    """A policy file that cannot be used; the message names file, rule, value and remedy."""


def read_policy(path: str | Path) -> Policy:
    """Read a policy, the shipped default if the path is empty; raise BadPolicy."""
    file = policy_file(path) if str(path) else DEFAULT
    try:
        return parse_policy(file.read_bytes().decode())
    except OSError as error:
        raise BadPolicy(f"cannot read the policy {file}: {error.strerror}") from error
    except tomllib.TOMLDecodeError as error:  # it names the line
        raise BadPolicy(f"policy {file} is not TOML: {error}") from error
    except ValueError as error:  # UnicodeDecodeError is one
        raise BadPolicy(f"policy {file}: {error}") from error


def policy_file(name: str | Path) -> Path:
    """Return the file of a policy that qmn or a package has by name, or that is a path itself."""
    return POLICIES.get(str(name), Path(name))


def require_network(policy: Policy, names: Collection[str], copies: str) -> None:
    """Raise BadPolicy for a fibre, closed or watched, between switches that there are not.

    And if the network is laid for another use of copies of set-up messages.
    """
    watched = [watch.over for watch in policy.watches]
    for place, named in (("closed", policy.closed), ("watch: over", watched)):
        for name in sorted(frozenset().union(*named) - set(names)):
            text = f"{place}: {name!r} is not a quantum switch of this network"
            raise BadPolicy(f"{text}: {remedy(name, sorted(names))}")
    if (setting := policy.metadata_at_switch) not in (None, copies):
        text = f"metadata_at_switch is {setting}, and this network is laid for {copies}"
        raise BadPolicy(f"{text}: start one with this policy, or --metadata-at-switch {setting}")


TABLES = {"device", "filter", "queue", "refusal", "report", "seal", "swap"}
SECTIONS = {*TABLES, "default", "metadata_at_switch", "rule", "tap", "closed", "watch", "trusted"}


def parse_policy(text: str) -> Policy:
    """Build the policy from its text; raise ValueError naming place, value and choices."""
    content = tomllib.loads(text)
    _only(content, "a policy", SECTIONS)
    tables = {name: _table(content.get(name, {}), name) for name in TABLES}
    rules, trusted = _array(content, "rule", MAX_RULES), _array(content, "trusted", MAX_TRUSTED)
    schedule, purification = _parse_swap(tables["swap"])
    queue = _parse_queue(tables["queue"])
    return Policy(
        default=_one_of(content.get("default", "allow"), ACTIONS, "default"),
        rules=tuple(_parse_rule(rule, f"rule {number}") for number, rule in enumerate(rules, 1)),
        devices={
            name: _parse_settings(device, f"device {name}")
            for name, device in tables["device"].items()
        },
        reporting=_parse_reporting(tables["report"]),
        taps=_parse_taps(_array(content, "tap", MAX_TAPS)),
        schedule=schedule,
        purification=purification,
        filter=_parse_filter(tables["filter"]),
        queue=queue,
        closed=_parse_closed(_array(content, "closed", MAX_CLOSED)),
        names_elements=_parse_refusal(tables["refusal"]),
        trusted=tuple(
            _parse_trusted(table, f"trusted {number}") for number, table in enumerate(trusted, 1)
        ),
        alarm=_parse_seal(tables["seal"]),
        watches=_parse_watches(_array(content, "watch", MAX_WATCHES), queue),
        metadata_at_switch=_of_copies(content.get("metadata_at_switch")),
    )


def _of_copies(value: Any) -> str | None:
    choices = REQUIRED, OBSERVED, OFF
    return None if value is None else _one_of(value, choices, "metadata_at_switch")


def _parse_rule(value: object, place: str) -> Rule:
    table = _table(value, place)
    _only(table, place, {"action", "service", *WHO, *LIMITS})
    if "action" not in table:
        raise ValueError(f'{place} has no action: write action = "allow" or action = "deny"')
    who: dict[str, Any] = {
        field_name: _typed(table.get(key, "*"), str, f"{place}: {key}", 'a host, or "*"')
        for key, field_name in WHO.items()
    }
    rule = Rule(
        action=_one_of(table["action"], ACTIONS, f"{place}: action"),
        service=_one_of(table.get("service", "*"), SERVICES, f"{place}: service"),
        **who,
        **{
            name: _number(table[name], *LIMITS[name], f"{place}: {name}")
            for name in LIMITS
            if name in table
        },
    )
    if rule.action == "deny" and any(name in table for name in LIMITS):
        raise ValueError(f"{place} denies and has limits: only rules that allow have them")
    return rule


def _parse_taps(values: list[Any]) -> tuple[Tap, ...]:
    taps: dict[frozenset[str], Tap] = {}
    for number, table in enumerate(values, 1):
        tap = _parse_tap(table, f"tap {number}")
        first = taps.setdefault(frozenset(tap.between), tap)
        if first is not tap:
            raise ValueError(f"tap {number}: there is a {first} already; keep one of them")
    return tuple(taps.values())


def _parse_tap(value: object, place: str) -> Tap:
    table = _table(value, place)
    _only(table, place, {"between", "by"})
    between, by = table.get("between"), table.get("by")
    remedy = 'write between = ["alice", "bob"] and by = "eve", three different hosts'
    if not isinstance(between, list) or len(between) != 2:
        raise ValueError(f"{place}: between is {between!r}: {remedy}")
    hosts = [*between, by]
    if not all(isinstance(host, str) and host for host in hosts) or len(set(hosts)) < len(hosts):
        raise ValueError(f"{place}: between is {between!r} and by is {by!r}: {remedy}")
    return Tap((between[0], between[1]), str(by))


def _parse_closed(values: list[Any]) -> frozenset[frozenset[str]]:
    closed = set()
    for number, value in enumerate(values, 1):
        place = f"closed {number}"
        table = _table(value, place)
        _only(table, place, {"between"})
        remedy = 'write between = ["q1", "q2"], two different switches'
        closed.add(_two(table.get("between"), place, remedy))
    return frozenset(closed)


def _parse_seal(table: dict[str, Any]) -> str:
    _only(table, "seal", {"alarm"})
    return _one_of(table.get("alarm", TELL), ALARMS, "seal: alarm")


def _parse_watches(values: list[Any], queue: Queue) -> tuple[Watch, ...]:
    if values and queue.order == SLOTS:
        raise ValueError(f'watch: not with the queue\'s order = "{SLOTS}", which plans all light')
    watches = tuple(_parse_watch(table, f"watch {place}") for place, table in enumerate(values, 1))
    for place, watch in enumerate(watches, 1):
        if watch in watches[: place - 1]:
            raise ValueError(f"watch {place}: {watch} is watched so already; keep one of them")
    return watches


def _parse_watch(value: object, place: str) -> Watch:
    table = _table(value, place)
    _only(table, place, {"between", "over", *RANGES})
    hosts = 'write between = ["alice", "bob"], two different hosts, of which the first makes pairs'
    between: Any = table.get("between")  # in this order, if they are two
    _two(between, place, hosts)
    over: frozenset[str] = frozenset()
    if "over" in table:
        remedy = 'write over = ["q1", "q2"], two different switches'
        over = _two(table["over"], place, remedy, "over")
    numbers = {
        name: _number(table[name], *RANGES[name], f"{place}: {name}")
        for name in RANGES
        if name in table
    }
    first, second = between
    return Watch((first, second), over, **numbers)


def _parse_trusted(value: object, place: str) -> Trusted:
    table = _table(value, place)
    _only(table, place, {"host", "between"})
    host = _typed(table.get("host"), str, f"{place}: host", 'a host, or "*"')
    if "between" not in table:
        return Trusted(host)
    remedy = 'write between = ["alice", "bob"], two other hosts'
    between = _two(table["between"], place, remedy)
    if host in between:
        raise ValueError(f"{place}: host {host!r} is one of between: {remedy}")
    return Trusted(host, between)


def _two(between: object, place: str, remedy: str, name: str = "between") -> frozenset[str]:
    names = between if isinstance(between, list) else []
    if len(names) != 2 or names[0] == names[1] or not all(_is_name(each) for each in names):
        raise ValueError(f"{place}: {name} is {between!r}: {remedy}")
    return frozenset(names)


def _is_name(value: object) -> bool:
    return isinstance(value, str) and bool(value)


def _parse_swap(table: dict[str, Any]) -> tuple[str, Purification]:
    _only(table, "swap", {"schedule", "purification", "rounds"})
    schedule = _one_of(table.get("schedule", PARALLEL), SCHEDULES, "swap: schedule")
    value = table.get("purification", UNPURIFIED.protocol)
    protocol = _one_of(value, tuple(PROTOCOLS), "swap: purification")
    rounds = _number(table.get("rounds", 0), 0, MAX_LEVEL_ROUNDS, "swap: rounds")
    return schedule, Purification(protocol, rounds)


def _parse_queue(table: dict[str, Any]) -> Queue:
    _only(table, "queue", {item.name for item in fields(Queue)})
    order = _one_of(table.get("order", Queue.order), tuple(ORDERS), "queue: order")
    if "slot_s" in table and order != SLOTS:
        raise ValueError(f'queue: slot_s is of order = "{SLOTS}", not of {order!r}')
    slot_s = table.get("slot_s", Queue.slot_s)
    return Queue(order, float(_number(slot_s, *SLOT_S, "queue: slot_s")))


def _parse_refusal(table: dict[str, Any]) -> bool:
    _only(table, "refusal", {"names_elements"})
    value = table.get("names_elements", True)
    return _typed(value, bool, "refusal: names_elements", "true or false")


def _parse_filter(table: dict[str, Any]) -> Filter:
    _only(table, "filter", {item.name for item in fields(Filter)})
    return Filter(
        **{
            name: _typed(value, bool, f"filter: {name}", "true or false")
            for name, value in table.items()
        }
    )


def _parse_settings(value: object, place: str) -> DeviceSettings:
    table = _table(value, place)
    _only(table, place, {item.name for item in fields(DeviceSettings)})
    try:
        numbers = {name: setting_number(name, number) for name, number in table.items()}
        settings = DeviceSettings(**numbers)
        check_settings(settings)
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error
    return settings


def _parse_reporting(table: dict[str, Any]) -> Reporting:
    _only(table, "report", {item.name for item in fields(Reporting)})
    ranges = {"period_s": PERIODS_S, "lost_share": MAX_SHARE, "symbol_error_share": MAX_SHARE}
    return Reporting(
        **{
            name: float(_number(value, *ranges[name], f"report: {name}"))
            for name, value in table.items()
        }
    )


def _only(table: dict[str, Any], place: str, names: set[str]) -> None:
    check_names(place, table, sorted(names))


def _array(content: dict[str, Any], name: str, most: int) -> list[Any]:
    tables: list[Any] = _typed(content.get(name, []), list, name, f"write it as [[{name}]]")
    if len(tables) > most:
        raise ValueError(f"{len(tables)} {name}s: at most {most}")
    return tables


def _table(value: object, place: str) -> dict[str, Any]:
    return _typed(value, dict, place, "a table")


def _typed(value: object, kind: type[T], place: str, remedy: str) -> T:
    if not isinstance(value, kind):
        raise ValueError(f"{place} is {value!r}: {remedy}")
    return value


def _one_of(value: Any, choices: tuple[str, ...], place: str) -> str:
    if isinstance(value, dict):
        line = f'{place.rpartition(" ")[2]} = "{choices[0]}"'
        raise ValueError(f"{place} is a table: write {line}, or one of {', '.join(choices[1:])}")
    check_choice(place, value, choices)
    return str(value)


def _number(value: Any, least: float, most: float, place: str) -> Any:
    check_number(place, value, least, most)
    return value
