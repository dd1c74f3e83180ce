"""The request of a job of `qmn run` by its name, as scripts and sweeps ask for it."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from qmn.network.options import NetworkOptions
from qmn.options import BadInput
from qmn.requests.run_options import RunOptions
from qmn.requests.service import ServiceRequest, parts_of, service_request
from qmn.requests.service_verbs import VERBS, Verb
from qmn.requests.superdense import SERVICE, SuperdenseRequest, superdense_request
from wire.parameters.checks import check_choice, remedy
from wire.parameters.network import KeySettings

FLAGS = {"from": "sender", "to": "receiver"}  # words of the command line that Python has taken
OF_NETWORK = frozenset(field.name for field in fields(NetworkOptions))
OF_RUN = frozenset(field.name for field in fields(RunOptions))
JOBS = (SERVICE, *VERBS)

JobRequest = ServiceRequest | SuperdenseRequest


def request_of(job: str, parameters: Mapping[str, Any]) -> JobRequest:
    """Return the request of a job that options fill, by their names on the command line.

    Raise BadInput for a job or an option there is not.
    """
    if job not in JOBS:
        raise BadInput(f"unknown job {job!r}: {remedy(job, JOBS)}")
    options = {FLAGS.get(name, name): value for name, value in parameters.items()}
    for name in sorted(options.keys() & OF_RUN):
        raise BadInput(f"{name} is of `qmn run`, which starts a network of its own: leave it out")
    if job == SERVICE:
        return superdense_request(**options)
    verb = VERBS[job]
    for name in sorted(options.keys() & _without_effect(verb)):
        raise BadInput(f"{name} has no effect on {job}: leave it out")
    service = options.pop("protocol", (verb.protocols or (job,))[0])
    check_choice("protocol", service, verb.protocols or (job,), BadInput)
    return service_request(service, **options)


def _without_effect(verb: Verb) -> set[str]:
    """Return the options that services have and this one has not."""
    beside = {field.name for part in ServiceRequest.__mro__[1:-1] for field in fields(part)}
    used = {field.name for part in parts_of(verb) for field in fields(part)}
    others = {"receiver"} if verb.line else set()
    keys = set() if verb.keys else {field.name for field in fields(KeySettings)}
    return (beside - used) | others | (set() if verb.source else {"source"}) | keys
