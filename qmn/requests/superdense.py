"""The request of a message by superdense coding."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hosts.middleware.services.superdense.options import SuperdenseOptions
from qmn.network.options import NetworkOptions
from qmn.options import from_keywords
from qmn.requests.run_options import RunOptions
from qmn.requests.service_verbs import APPLICATION_PORT
from wire.metadata.vocabulary import Service
from wire.parameters.option import option

SERVICE = Service.SDC.name.lower()


@dataclass(frozen=True, kw_only=True)
class SuperdenseRequest:
    """A message to send, how, and in which network."""

    # The result of a run has the file of both.
    message: str | None = option(
        None, "text to send (default: a short one)", instead_of="what", recorded=False
    )
    file: Path | None = option(None, "file to send", instead_of="what", recorded=False)
    sender: str = option("alice", "sending host (alice)", flag="--from", metavar="HOST")
    options: SuperdenseOptions  # of its session, with the host that is sent to
    network: NetworkOptions
    run: RunOptions

    @property
    def receiver(self) -> str:
        return self.options.host


def superdense_request(
    receiver: str = "bob", topology: str = "", **keywords: Any
) -> SuperdenseRequest:
    """Return the request that options fill, by their names; raise BadInput for one there is not."""
    return from_keywords(
        SuperdenseRequest,
        keywords,
        host=receiver,
        port=APPLICATION_PORT,
        topology=topology or ("" if keywords.get("map") else "sdc"),
    )
