"""Public API of services: their declaration, their two ends, and their place on the command line.

Names are loaded when they are asked for, because controller, switches and dispatcher read the
declarations alone: docs/adding-a-service.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hosts.hardware.operations import BlockName as BlockName
    from hosts.hardware.qnic import Qnic as Qnic
    from hosts.hardware.replies import HardwareError as HardwareError
    from hosts.hardware.replies import Symbols as Symbols
    from hosts.hardware.simulated import SimulatedQnic as SimulatedQnic
    from hosts.middleware.session.ends import AcceptorEnd as AcceptorEnd
    from hosts.middleware.session.ends import Carrier as Carrier
    from hosts.middleware.session.ends import OpenerEnd as OpenerEnd
    from hosts.middleware.session.ends import ServiceKind as ServiceKind
    from hosts.middleware.session.errors import SessionError as SessionError
    from hosts.middleware.session.options import ServiceOptions as ServiceOptions
    from hosts.middleware.session.protocol import Hear as Hear
    from hosts.middleware.session.protocol import HostSide as HostSide
    from hosts.middleware.session.protocol import OpenerSide as OpenerSide
    from hosts.middleware.session.protocol import Say as Say
    from hosts.middleware.session.protocol import Steps as Steps
    from hosts.middleware.session.protocol import Tell as Tell
    from hosts.middleware.session.protocol import do as do
    from hosts.middleware.session.protocol import hear as hear
    from qmn.requests.service_verbs import Verb as Verb
    from wire.features import ABSORB as ABSORB
    from wire.features import EMIT as EMIT
    from wire.features import GATE as GATE
    from wire.features import HERALD as HERALD
    from wire.features import INTERFERE as INTERFERE
    from wire.features import MEASURE as MEASURE
    from wire.features import STORE as STORE
    from wire.features import Feature as Feature
    from wire.light import ACCEPTOR as ACCEPTOR
    from wire.light import OPENER as OPENER
    from wire.light import PAIRS as PAIRS
    from wire.light import SOURCE as SOURCE
    from wire.light import TO_NEXT as TO_NEXT
    from wire.light import Beam as Beam
    from wire.light import FiberOf as FiberOf
    from wire.light import RegisteredService as RegisteredService
    from wire.light import Role as Role
    from wire.malformed import MalformedPacket as MalformedPacket
    from wire.metadata.values import Envelope as Envelope
    from wire.metadata.values import Topic as Topic
    from wire.metadata.values import Values as Values
    from wire.metadata.vocabulary import Reason as Reason
    from wire.metadata.vocabulary import Service as Service
    from wire.outcomes import NO_COINCIDENCE as NO_COINCIDENCE
    from wire.parameters.option import option as option
    from wire.results.figures import Figures as Figures

_MODULES = {
    "hosts.hardware.operations": "BlockName",
    "hosts.hardware.qnic": "Qnic",
    "hosts.hardware.replies": "HardwareError Symbols",
    "hosts.hardware.simulated": "SimulatedQnic",
    "hosts.middleware.session.ends": "AcceptorEnd Carrier OpenerEnd ServiceKind",
    "hosts.middleware.session.errors": "SessionError",
    "hosts.middleware.session.options": "ServiceOptions",
    "hosts.middleware.session.protocol": "Hear HostSide OpenerSide Say Steps Tell do hear",
    "qmn.requests.service_verbs": "Verb",
    "wire.features": "ABSORB EMIT GATE HERALD INTERFERE MEASURE STORE Feature",
    "wire.light": "ACCEPTOR OPENER PAIRS SOURCE TO_NEXT Beam FiberOf RegisteredService Role",
    "wire.malformed": "MalformedPacket",
    "wire.metadata.values": "Envelope Topic Values",
    "wire.metadata.vocabulary": "Reason Service",
    "wire.outcomes": "NO_COINCIDENCE",
    "wire.parameters.option": "option",
    "wire.results.figures": "Figures",
}
_PLACES = {name: module for module, names in _MODULES.items() for name in names.split()}


def __dir__() -> list[str]:
    return sorted(_PLACES)


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"qmn.services has no {name}")
    return getattr(import_module(_PLACES[name]), name)
