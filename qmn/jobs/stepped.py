"""Checks of `--time stepped`: what the gate cannot see, or the wall paces, is refused."""

from qmn.network.options import NetworkOptions
from qmn.network.time_scale import REAL
from qmn.options import BadInput
from qmn.requests.run_options import STEPPED, RunOptions


def refuse_stepped(run: RunOptions, reason: str) -> None:
    """Raise BadInput if a run is to be stepped."""
    if run.time == STEPPED:
        raise BadInput(f"--time {STEPPED}: {reason}; leave it out")


def check_stepped(run: RunOptions, network: NetworkOptions) -> None:
    """Raise BadInput for a stepped run with an option that only paced time has."""
    found = {
        "--time-scale is of paced time": network.time_scale != REAL,
        "other machines have clocks of their own (--machines)": run.machines > 1 or run.place,
        "TCP repeats by the wall what --control-loss loses": network.control_loss,
        "the kernel counts --classical-mbps by the wall": run.classical_mbps is not None,
        "what runs in the server of --sabot cannot be seen": network.sabot,
        "the controller looks at a --policy by the wall": network.policy,
        "--app modules have timers of their own": network.apps,
    }
    for reason in (reason for reason, is_asked in found.items() if is_asked):
        refuse_stepped(run, reason)
