"""What every node of a network of ours is."""

from pathlib import Path

from topologies.interfaces import switch_ipv6_off
from topologies.programs import ROOT, python
from topologies.runtime import Runtime
from topologies.shells import ShellWatcher


class QuantumNode(ShellWatcher):
    """A node of a network of ours, which says when what sets it up must not take long."""

    network: Runtime

    @property
    def hurried(self) -> bool:  # type: ignore[override]
        """Whether the network starts or ends just now."""
        return self.network.hurried

    def startShell(self, mnopts: str | None = None) -> None:  # noqa: N802 (Mininet's name)
        """Start the shell; in a network of its own IPv6 is off from the beginning."""
        super().startShell(mnopts)
        self.without_ipv6()

    def without_ipv6(self) -> None:
        """Switch IPv6 off where that concerns nobody else."""
        if self.inNamespace:
            switch_ipv6_off(self, "all", "default")

    def find_our_programs(self) -> None:
        """Let `qmn spy`, and `python` with our packages, work in the node's shell."""
        folders = f"{ROOT / 'bin'}:{Path(python()).parent}"
        self.cmd(f'export PYTHONPATH="{ROOT}" PATH="{folders}:$PATH"')
