"""Checks of `--time stepped`: what the gate cannot see, or the wall paces, is refused."""

from qmn.network.checks import refuse_stepped
from qmn.network.options import NetworkOptions
from qmn.requests.run_options import RunOptions


def check_stepped(run: RunOptions, network: NetworkOptions) -> None:
    """Raise BadInput for a stepped run with an option that only paced time has."""
    if run.machines > 1 or run.place:
        refuse_stepped(network, "other machines have clocks of their own (--machines)")
    if run.classical_mbps is not None:
        refuse_stepped(network, "the kernel counts --classical-mbps by the wall")
