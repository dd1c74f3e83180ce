"""A fork server that a loaded one forks off, and that loads a framework of the controller, too."""

import os
import sys

from topologies.system.processes import fork_server

FRAMEWORK = "QMN_CONTROLLER_FRAMEWORK"  # names what to load


def main() -> int:
    """Serve as a fork server does; the first word names the framework."""
    os.environ[FRAMEWORK] = sys.argv.pop(1)
    return fork_server.main()
