"""--eve FRACTION --at S --until S: an eavesdropper who comes to the fibre of a run, and leaves.

The policy of the controller puts her on the fibre and takes her off again, as `qmn policy reload`
would; sessions that are open stay as they are.
"""

import argparse
import json
from pathlib import Path

from mininet.topo import Topo

from controller_apps.policy.policy import DEFAULT
from qmn.jobs import eavesdropping
from qmn.jobs.moments import Moments
from qmn.jobs.transfer import START_TIMEOUT_S
from qmn.live.controller_console import ask
from qmn.network.options import BadInput, check_range
from topologies.network import Network
from topologies.programs import Program, python

MOST_S = 86_400.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Describe the options."""
    eavesdropping.add_option(parser)
    add = parser.add_argument
    add("--at", type=float, default=10.0, metavar="S", help="when eve comes (10)")
    add("--until", type=float, default=None, metavar="S", help="when she leaves (never)")


def check(arguments: argparse.Namespace, topo: Topo) -> None:
    """Raise BadInput if she cannot come so."""
    eavesdropping.check(arguments, topo)
    check_range(arguments, "at", 0, MOST_S)
    if arguments.until is not None and arguments.until <= arguments.at:
        raise BadInput(f"--until {arguments.until:g} is not after --at {arguments.at:g}")


class PassingEavesdropper:
    """Comes and leaves when it is time."""

    def __init__(self, arguments: argparse.Namespace, folder: Path, light_from: str) -> None:
        """Write the policy without her, and let it be in force from the start."""
        self._fraction = arguments.eve
        self._at_s, self._until_s = arguments.at, arguments.until
        self._between = light_from, arguments.receiver
        self._file = folder / eavesdropping.POLICY
        self._eve: Program | None = None
        self._gone = self._fraction is None
        if not self._gone:
            self._file.write_text(DEFAULT.read_text())
            arguments.policy = self._file

    def look(self, network: Network, moments: Moments) -> None:
        """Do what it is time for."""
        if self._gone:
            return
        if self._eve is None and moments.now_s >= self._at_s:
            self._eve = self._come(network)
            moments.add("eve_comes", fraction=self._fraction)
        elif self._eve and self._until_s is not None and moments.now_s >= self._until_s:
            self._file.write_text(DEFAULT.read_text())
            ask("reload-policy")
            self._eve.stop()
            self._gone = True
            moments.add("eve_leaves", **eavesdropping.summary_of(self._eve))

    def _come(self, network: Network) -> Program:
        name, socket = eavesdropping.EVE, network.runtime.socket(eavesdropping.EVE)
        command = [python(), "-m", "hosts.applications.intercept", "--stack", socket]
        eve = network.run_on(name, "eve-intercepts", [*command, str(self._fraction)])
        eve.wait_for("intercepting", START_TIMEOUT_S)
        tap = f"\n[[tap]]\nbetween = {json.dumps(self._between)}\nby = {json.dumps(name)}\n"
        self._file.write_text(DEFAULT.read_text() + tap)
        ask("reload-policy")
        return eve
