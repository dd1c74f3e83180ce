"""The garbage collector while tests are collected and run, a plug-in: what stays is looked at once.

Modules and thousands of tests are a million objects that live to the end. The collector would go
through all of them several times in each process, for a fifth of the time that collecting takes;
and tests make many objects: looking each 700 of them, as it does by itself, costs another
twentieth.
"""

import gc

OBJECTS, YOUNG, OLDER = 20_000, 20, 10  # made before each generation is looked through


def pytest_collection() -> None:
    """Begin to collect tests."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Have what tests make looked through from now on."""
    gc.freeze()
    gc.set_threshold(OBJECTS, YOUNG, OLDER)
    gc.enable()
