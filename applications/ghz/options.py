"""Options of GHZ states."""

from dataclasses import dataclass

from hosts.middleware.session.errors import unsupported
from hosts.middleware.session.options import MAX_COUNT, ServiceOptions
from wire.parameters.option import option

LEAST_HOSTS, MOST_HOSTS = 2, 16  # of two it is a Bell pair


@dataclass(frozen=True)
class GhzOptions(ServiceOptions):
    """`count` states of all hosts, measured to tell how good they are."""

    # The host that asks, the one that is asked, others.
    line: str = option(
        "alice,bob,charlie",
        "hosts in the order of their links: each makes pairs with the next (alice,bob,charlie)",
        metavar="A,B,C",
    )
    count: int = option(10_000, "states (10000)", metavar="N", range=(1, MAX_COUNT))

    @property
    def names(self) -> list[str]:
        return self.line.split(",")

    def check(self) -> None:
        super().check()
        if not isinstance(self.line, str):
            raise unsupported(f"line {self.line!r}: write A,B,C")
        names = self.names
        if not LEAST_HOSTS <= len(set(names)) == len(names) <= MOST_HOSTS:
            text = f"line {self.line}: name {LEAST_HOSTS} to {MOST_HOSTS}, each once, as A,B,C"
            raise unsupported(text)
        if names[1] != self.host:
            raise unsupported(f"line {self.line}: {self.host} is asked, so it has to be the second")
