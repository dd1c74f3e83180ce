"""The start of a job by the name of its module, for the verbs that have jobs."""

from functools import partial
from importlib import import_module
from typing import Any


def run_job(module: str, request: Any) -> int:
    """Run a job; its module is loaded now, because help has no use for it."""
    from qmn.jobs.run_context import guarded

    return guarded(partial(import_module(module).run, request))
