"""Networks for Python scripts: see docs/scripting.md."""

from qmn.scripting.network import QuantumNetwork, running, start

__all__ = ["QuantumNetwork", "running", "start"]
