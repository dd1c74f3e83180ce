"""Names that a node can have: interfaces, options and files of a run are called after it."""

import re

from wire.parameters.physics import BadParameter

# `-` and `.` divide names from what is behind them: s1-eth1, q1-agent, --fiber q1-q2.length_km.
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
PROGRAMS = {"c0", "dispatcher", "copper", "gate", "asked", "asking"}
SOCKETS = {"console"}
FILES = {"quantum", "hosts", "ca"}  # NAME.log, NAME.json or NAME.pem
FOLDERS = {"tls", "keys", "written", "certificates"}
IDENTITIES = {"runner", "operator"}  # with a secret or a certificate of their own
INTERFACES = {"lo", "all", "default"}  # of any Linux, under /proc/sys/net/ipv4/conf
RESERVED = frozenset(PROGRAMS | SOCKETS | FILES | FOLDERS | IDENTITIES | INTERFACES)


def check_name(name: str) -> None:
    """Raise BadParameter for a name that no node can have."""
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise BadParameter(
            f"{name!r} cannot be a node's name: begin with a letter of a to z or A to Z; digits "
            "and _ may follow"
        )
    if name in RESERVED:
        raise BadParameter(
            f"{name!r} cannot be a node's name: a program, file or interface of every run has it; "
            "choose another"
        )
