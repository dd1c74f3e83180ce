"""Networks for Python scripts: see docs/scripting.md."""

from qmn.scripting.network import QuantumNetwork
from qmn.scripting.own_run import run
from qmn.scripting.start import running, start, start_for
from qmn.scripting.tables import TableOf

__all__ = ["QuantumNetwork", "TableOf", "run", "running", "start", "start_for"]
