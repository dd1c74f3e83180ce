"""Commands that run as on a machine of their own, beside other networks on this one."""

import os
from collections.abc import Sequence
from contextlib import suppress

from topologies.system.confinement.confinement import descendants
from topologies.system.processes.commands import WITH_THIS_PROCESS
from topologies.system.processes.programs import ROOT

OWN_NAMESPACES = ROOT / "topologies" / "own_namespaces"


def apart(command: Sequence[str]) -> list[str]:
    """Return what runs a command in namespaces of its own, as root.

    All that it has started there ends at once with the process that this starts, also if that is
    killed, and that one with the thread that has started it. What the kernel held for them goes.
    """
    return [*WITH_THIS_PROCESS, str(OWN_NAMESPACES), *command]


def inside(pid: int) -> list[int]:
    """Return the first processes in the namespaces that a process has begun by `apart`.

    These are the keeper of the namespaces and the command in it, by their ids here.
    """
    here = os.readlink("/proc/self/ns/pid")
    found = []
    for each in descendants(pid):
        with suppress(FileNotFoundError, ProcessLookupError):  # it has ended
            if os.readlink(f"/proc/{each}/ns/pid") != here:
                found.append(each)
    return found
