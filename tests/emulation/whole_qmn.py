"""qmn with all that it loads when it needs it: the fork server of these tests forks it off."""

from importlib import import_module

from evidence.verb import KINDS
from qmn.__main__ import MODULES
from qmn.__main__ import main as main
from qmn.parser import module_of
from qmn.verbs.set import WHAT

for loaded in (*MODULES.values(), "views.report.page"):
    import_module(loaded)
for _text, function in (*KINDS.values(), *WHAT.values()):
    module_of(function)
