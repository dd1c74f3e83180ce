"""The job `qmn run coin`."""

from qmn.services import Verb

COIN = Verb("throw coins that two hosts have in common", "coins", source=True)
