"""qmn with all that it loads when it needs it: the fork server of these tests forks it off."""

from importlib import import_module

from qmn.__main__ import MODULES
from qmn.__main__ import main as main

for loaded in (*MODULES.values(), "views.report.page"):
    import_module(loaded)
