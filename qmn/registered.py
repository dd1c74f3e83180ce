"""The door of packages: what they register by entry points (docs/architecture.md).

The metadata of an installed package has them, or a folder NAME.dist-info beside a package. The core
imports no such package by name.
"""

from importlib.metadata import EntryPoint, entry_points

VERBS = "qmn.verbs"  # by heading, verb: module and help
JOBS = "qmn.jobs"  # of `qmn run`: a module with HELP and describe(parser)
SERVICE_VERBS = "qmn.service_verbs"  # qmn.requests.service_verbs.Verb, by its name
REQUESTS = "qmn.requests"  # dataclass of a request, by the service that a result names
PROGRAMS = "qmn.programs"  # qmn.network.programs.NetworkProgram, for `qmn cli`
DISSECTORS = "qmn.dissectors"  # a module with LUA, a script, and tables() that it reads
JOB = "the job"  # group of a job's own options


def registered(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name; raise ImportError if two have the same."""
    found = sorted(entry_points(group=group), key=lambda each: each.name)
    named = {each.name: each for each in found}
    if len(named) < len(found):
        values = ", ".join(each.value for each in found)
        raise ImportError(f"two entry points of {group} have the same name: {values}; remove one")
    return named
