"""A NetQASM application on a network that goes on standing, as network.netqasm(path="my-app")."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from applications.netqasm.carried import CarriedApplication
from applications.netqasm.job import checked, play
from applications.netqasm.request import NetqasmRequest
from qmn.jobs.on_network import Planned
from qmn.network.description import NetworkDescription
from qmn.options import BadInput, from_keywords
from qmn.requests.run_options import RunOptions
from topologies.networks.network import Network
from wire.results.run_result import NetqasmJob


def planned(
    network: Network, description: NetworkDescription, parameters: Mapping[str, Any], folder: Path
) -> Planned:
    """Return the application with these options; raise BadInput for what cannot be."""
    options = dict(parameters)
    if "path" not in options:
        raise BadInput("netqasm: say which application: path='my-app'")
    path, of_network = Path(options.pop("path")), description.options
    request = from_keywords(
        NetqasmRequest,
        options,
        path=path,
        state_inspection=of_network.state_inspection,  # for all programs
        network=of_network,
        run=RunOptions(runs=folder),
    )
    application = checked(request, description.hosts)
    request = replace(request, path=application.path)
    hosts = list(application.hosts.values())
    copies = CarriedApplication(application.path, hosts, folder)
    copies.prepare(network.runtime.places)
    job = NetqasmJob(roles=dict(application.hosts))

    def perform() -> None:
        play(application, copies, network, folder, job.outputs, label=f"{folder.name}-")

    return Planned("netqasm", hosts, job, request, perform)
