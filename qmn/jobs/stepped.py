"""Reasons of a run why its time is paced."""

from collections.abc import Iterator

from qmn.network.description import NetworkDescription
from qmn.requests.run_options import RunOptions


def with_pace(network: NetworkDescription, run: RunOptions) -> NetworkDescription:
    """Return the network as a run of these options paces it; raise BadInput if it cannot be so."""
    return network.paced_for(*_against_steps(run))


def _against_steps(run: RunOptions) -> Iterator[str]:
    if run.machines > 1 or run.place:
        yield "other machines have clocks of their own (--machines)"
    if run.classical_mbps is not None:
        yield "the kernel counts --classical-mbps by the wall"
