"""The part that all nodes of a network of ours share."""

import os
from pathlib import Path

from topologies.system.kernel.interfaces import set_up, switch_ipv6_off, within
from topologies.system.processes.programs import ROOT, python
from topologies.system.processes.shells import ShellWatcher
from topologies.system.runs.runtime import Runtime


class QuantumNode(ShellWatcher):
    """A node of a network of ours, which says when what sets it up must not take long."""

    network: Runtime

    @property
    def time_limited(self) -> bool:  # type: ignore[override]
        return self.network.time_limited

    @property
    def ending(self) -> bool:  # type: ignore[override]
        return self.network.ending

    def startShell(self, mnopts: str | None = None) -> None:  # noqa: N802 (Mininet's name)
        """Start the shell; in a network of its own IPv6 is off from the beginning."""
        super().startShell(mnopts)
        self.without_ipv6()

    def without_ipv6(self) -> None:
        """Switch IPv6 off where that concerns nobody else."""
        if self.inNamespace:
            switch_ipv6_off(self, "all", "default")

    def environment(self) -> dict[str, str]:
        folders = ROOT / "bin", Path(python()).parent, os.environ["PATH"]
        return {"PYTHONPATH": str(ROOT), "PATH": ":".join(map(str, folders))}

    def cmd(self, *arguments: object, **options: object) -> str:
        """Run a command in the node's shell; what Mininet has each node do takes no program."""
        if " ".join(map(str, arguments)) == "ifconfig lo up":
            within(self, set_up, "lo")
            return ""
        return super().cmd(*arguments, **options)
