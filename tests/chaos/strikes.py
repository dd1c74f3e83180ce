"""Faults that strike a run: its processes, Open vSwitch, a fibre, the runner, its output."""

import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from random import Random

import machine
from under_way import DISK, PIPE, TERMINAL, UnderWay

SIGNALS = (
    signal.SIGKILL,
    signal.SIGKILL,
    signal.SIGTERM,
    signal.SIGTERM,
    signal.SIGSTOP,
    signal.SIGSEGV,
)
Roles = Sequence[tuple[str, str]]
RUNNER, OUTPUT = "runner", "output"
TO_RUNNER = (
    *(signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL),
    *(signal.SIGQUIT, signal.SIGUSR1),
)
OUTPUT_SHARE = {PIPE: 0.05, TERMINAL: 0.5, DISK: 0.5}  # of strikes at a run that writes there
OPEN_VSWITCH = tuple((f"^{name} ", name) for name in machine.DAEMONS)
ROLES = (  # a pattern of the command line, and the name that a run gives to what matches
    (r"-m dispatcher ", "dispatcher"),
    (r"-m controller_apps ", "c0"),
    (r"-m qswitch_agent .*/(\S+-agent)\.json", r"\1"),
    (r"-m hosts\.key_delivery .*/(kme-\w+)\.json", r"\1"),
    (r"-m hosts\.applications\.vpn .*/(vpn-\w+)\.json", r"\1"),
    (r"-m hosts\.applications\.download ", "download-"),
    (r"-m http\.server ", "http-"),
    (r"^wireguard-go .*wg-(\w+)", r"wireguard-\1"),
    (r"-m hosts --config \S*/(\w+)\.json", r"\1"),
    (r"-m copper ", "copper"),
    (r"-m gate ", "gate"),
    (r"-m topologies\.system\.processes\.fork_server ", "fork-server"),
    (r"-m hosts\.applications\.service .*--options", "asking"),
    (r"-m hosts\.applications\.service ", "asked"),
    (r"^tcpdump .*-i (\S+)", "tcpdump"),
    (r"mininet:(\S+)", r"\1"),
)


@dataclass(frozen=True)
class Strike:
    """One strike that was made."""

    target: str  # kind and name
    how: str
    names: tuple[str, ...]  # one of which the cause is to have; none: nothing need fail
    ends: bool = False  # whether the run ends by it without clean-up, as a killed runner
    stalls: bool = False  # whether it leaves a peer that does not answer


def strike(run: UnderWay, random: Random) -> Strike | None:
    """Strike something of a run that exists now; None if nothing does yet."""
    if random.random() < OUTPUT_SHARE[run.output] and not run.output_lost:
        run.lose_output()
        return Strike(OUTPUT, f"{run.output} lost", ())
    runner = run.pid
    kinds: list[tuple[int, Callable[[int, Random], Strike | None]]] = [
        (12, process),
        (3, daemon),
        (3, the_runner),
        (3, fiber),
    ]
    weights = [weight for weight, _kind in kinds]
    (kind,) = random.choices([kind for _weight, kind in kinds], weights)
    return kind(runner, random) or process(runner, random)


def process(runner: int, random: Random) -> Strike | None:
    """Strike one of the programs and shells of the run."""
    return _one_of(ROLES, runner, random)


def daemon(runner: int, random: Random) -> Strike | None:
    """Strike a daemon of Open vSwitch."""
    return _one_of(OPEN_VSWITCH, runner, random)


def _one_of(roles: Roles, runner: int, random: Random) -> Strike | None:
    found = sorted(
        (name, each.pid)
        for each in machine.descendants(runner)
        if (name := _role(roles, " ".join(each.command)))
    )
    if not found:
        return None
    name, pid = random.choice(found)
    return _sent(name, pid, random.choice(SIGNALS))


def _role(roles: Roles, command: str) -> str:
    for pattern, name in roles:
        if matched := re.search(pattern, command):
            return matched.expand(name)
    return ""


def _sent(name: str, pid: int, number: signal.Signals) -> Strike | None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return None
    return Strike(name, number.name, (name,), stalls=number == signal.SIGSTOP)


def the_runner(runner: int, random: Random) -> Strike | None:
    """Ask the runner to end, or kill it."""
    number, twice = random.choice(TO_RUNNER), random.random() < 0.3
    pause_s = random.uniform(0.5, 2.0)  # as somebody has who loses patience
    try:
        os.kill(runner, number)
    except ProcessLookupError:
        return None
    if twice:
        time.sleep(pause_s)
        try:
            os.kill(runner, number)
        except ProcessLookupError:
            twice = False
    ends = twice or number == signal.SIGKILL
    how = f"{number.name} twice" if twice else number.name
    return Strike(RUNNER, how, ("interrupted", "second"), ends=ends)


def fiber(runner: int, random: Random) -> Strike | None:
    """Cut a fibre, at a quantum switch; a run may find another way, or say why it does not."""
    inside = machine.network_of(runner)
    if inside is None:
        return None
    enter = ("nsenter", f"--net=/proc/{inside}/ns/net")
    with suppress(subprocess.CalledProcessError):  # it has just ended
        names = re.findall(r"(q\d+-eth(?:[2-9]|\d\d))@", machine.run(*enter, "ip", "link"))
        if names:
            name = random.choice(names)
            machine.run(*enter, "ip", "link", "set", name, "down")
            return Strike(f"fibre {name}", "down", ())
    return None
