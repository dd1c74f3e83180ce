"""The simulation backends by name."""

from dispatcher.sabot.backend import Backend
from dispatcher.sabot.tableau import Tableau

BACKENDS: dict[str, type[Backend]] = {backend.NAME: backend for backend in (Tableau,)}
