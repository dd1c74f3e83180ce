"""Where the programs of an application are: which host each role has."""

from collections.abc import Mapping
from dataclasses import dataclass

from wire.parameters.checks import remedy


@dataclass(frozen=True)
class Placement:
    """The roles of an application, at hosts; known to all of its programs."""

    hosts: Mapping[str, str]  # by role
    addresses: Mapping[str, str]  # by role
    stacks: Mapping[str, str | None]  # by role, of those that run in this process; None: QMN_STACK

    def host(self, role: str) -> str:
        return self.hosts[self.known(role)]

    def known(self, role: str) -> str:
        """Return a role; raise ValueError if there is none of that name."""
        if role not in self.hosts:
            text = f"{role!r} is not a role of this application"
            raise ValueError(f"{text}: {remedy(role, sorted(self.hosts))}")
        return role
