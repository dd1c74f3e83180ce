"""The half of each pair that carries the message, by the direction of a session."""

from collections.abc import Sequence

from wire.metadata import Service, Setup


def sent_half(setup: Setup) -> int:
    """Return which half of each pair comes to the sender, by its first fibre."""
    return int(setup.service == Service.SDC_RETURN)


def arrival_ports(setup: Setup, ports: Sequence[str]) -> tuple[str, str]:
    """Return where halves 0 and 1 arrive at the receiver.

    What the sender passes on comes by the second fibre, the other half by the first one.
    """
    first, second = ports[:2]
    return (second, first) if sent_half(setup) == 0 else (first, second)
