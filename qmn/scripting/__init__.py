"""Networks for Python scripts: see docs/scripting.md."""

from qmn.scripting.network import QuantumNetwork
from qmn.scripting.start import running, start, start_for
from qmn.scripting.tables import TableOf

__all__ = ["QuantumNetwork", "TableOf", "running", "start", "start_for"]
