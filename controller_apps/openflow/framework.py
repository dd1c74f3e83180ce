"""The one place that knows which OpenFlow framework is loaded: Ryu or os-ken.

A process loads one of them, named by the environment before this module is imported.
Both have the same interface under different package names; neither has types.
"""

import logging
import os
import socket
import warnings
from collections.abc import Callable, Iterable
from functools import cache, partial, wraps
from importlib import import_module
from types import ModuleType
from typing import Any, Protocol, TypeVar, cast

from controller_apps.openflow.connection import Connection, SharedAccept, Speakers, owner
from programs.faults import report_fault

VARIABLE = "QMN_CONTROLLER_FRAMEWORK"
PACKAGES = {"ryu": "ryu", "os-ken": "os_ken"}
NAME = os.environ.get(VARIABLE, "ryu")

Handler = TypeVar("Handler", bound=Callable[..., None])


def _import(name: str) -> ModuleType:
    with warnings.catch_warnings():
        # Invalid escapes, eventlet's own deprecation: others' code, nothing to do about it.
        warnings.simplefilter("ignore")
        return import_module(name)


def _load(module: str) -> ModuleType:
    return _import(f"{PACKAGES[NAME]}.{module}")


if NAME not in PACKAGES:
    raise ValueError(f"framework {NAME!r} is unknown: choose one of {', '.join(PACKAGES)}")
if NAME == "ryu":
    # Ryu 4.34 imports this name, which eventlet has no more.
    vars(_import("eventlet.wsgi")).setdefault("ALREADY_HANDLED", b"")

hub: Any = _load("lib.hub")
cfg: Any = _load("cfg")
app_manager: Any = _load("base.app_manager")
ofp_event: Any = _load("controller.ofp_event")
_controller: Any = _load("controller.controller")  # declares the options that serve_on sets
_handler: Any = _load("controller.handler")
_event: Any = _load("controller.event")
_protocol: Any = _load("ofproto.ofproto_protocol")
lldp: Any = _load("lib.packet.lldp")
ofproto: Any = _load("ofproto.ofproto_v1_4")
parser: Any = _load("ofproto.ofproto_v1_4_parser")

_App: Any = getattr(app_manager, "RyuApp" if NAME == "ryu" else "OSKenApp")
Event: Any = _event.EventBase
ProtocolDesc: Any = _protocol.ProtocolDesc
CONFIG: str = _handler.CONFIG_DISPATCHER
MAIN: str = _handler.MAIN_DISPATCHER
DEAD: str = _handler.DEAD_DISPATCHER


class Datapath(Protocol):
    """The connection of a switch, as both frameworks have it; messages are the framework's."""

    id: int
    ports: dict[int, Any]
    unreplied_echo_requests: list[int]

    def send_msg(self, message: Any) -> bool: ...

    def send(self, data: bytes | bytearray, close_socket: bool = False) -> bool: ...

    def set_xid(self, message: Any) -> int: ...


class SwitchServer(hub.StreamServer):
    """The OpenFlow listener, with a share of its connections for each peer."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.server: Any = SharedAccept(vars(self)["server"], hub.sleep)


vars(_controller).update(StreamServer=SwitchServer)
_serve_in_turn: Any = _controller.datapath_connection_factory
_send_in_turn: Any = _controller.Datapath.send


def serve_quickly() -> None:
    """Have Ryu serve switches over connections that take less of a processor, from now on."""
    if NAME == "ryu":
        vars(_controller).update(datapath_connection_factory=_serve)
        _controller.Datapath.send = _send


def _serve(green_socket: Any, address: Any) -> None:
    """Serve a switch that has connected, in a green thread of its own."""
    _serve_in_turn(Connection(green_socket, partial(hub.sleep, 0)), address)


def _send(datapath: Any, data: bytes | bytearray, close_socket: bool = False) -> bool:
    """Send to a switch, at once if nothing waits to be sent; tell whether it could be."""
    queue = datapath.send_q
    if queue and queue.empty() and queue.getting() and not close_socket:
        data = data[datapath.socket.send_now(data) :]
        if not data:
            return True
    return bool(_send_in_turn(datapath, data, close_socket))


class App(_App):
    """Base of the apps: a fault in a handler ends the process.

    Left to itself, Ryu logs the fault and goes on, and os-ken silently ends the app's thread.
    """

    def register_handler(self, event_class: Any, handler: Any) -> None:
        @wraps(handler)
        def guarded(event: Any) -> None:
            with EndOnFault(self.name):
                if speaks_for_its_switch(event):
                    handler(event)

        super().register_handler(event_class, guarded)

    def _send_event(self, event: Any, state: Any) -> None:
        """Put an event into this app's queue; called by the framework, for all that handle it.

        To be woken for what is another's takes as long as to handle it.
        """
        if not isinstance(event, ofp_event.EventOFPPacketIn) or self.takes(event.msg):
            super()._send_event(event, state)

    def takes(self, message: Any) -> bool:
        """Tell whether a packet that a switch has sent up (PACKET_IN) is of this app."""
        return True


SPEAKERS = Speakers(DEAD, owner)


def speaks_for_its_switch(event: Any) -> bool:
    """Tell whether an event may be heeded: all may but those of who poses as a switch."""
    message = getattr(event, "msg", None)
    datapath = getattr(message or event, "datapath", None)
    dpid = getattr(message, "datapath_id", None) or getattr(datapath, "id", None)
    return dpid is None or SPEAKERS.admits(datapath, dpid)


class EndOnFault:
    """Ends the process, after saying why, if its block raises."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __enter__(self) -> None:
        """Begin the block."""

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        """End the process if the block has failed; leave what ends a thread alone."""
        if isinstance(error, Exception):
            logging.getLogger(self.name).critical("fault in a handler", exc_info=error)
            report_fault(f"controller: fault in {self.name}, see above: {error!r}")
            os._exit(1)


def on(event: Any, *states: str) -> Callable[[Handler], Handler]:
    """Register a method as handler of an event, in the given states of a connection."""
    return cast(Callable[[Handler], Handler], _handler.set_ev_cls(event, list(states)))


@cache
def wsgi() -> Any:
    """Return Ryu's WSGI server; raise ValueError on os-ken, which has none."""
    if NAME != "ryu":
        raise ValueError(f"rest: the framework {NAME} has no WSGI server; use ryu, or the console")
    return _load("app.wsgi")


def load_stock_apps(modules: Iterable[str]) -> None:
    """Import apps that are not ours, and those that they need: before serve_on, for options.

    Raise ValueError naming a module that is not there.
    """
    manager = app_manager.AppManager.get_instance()
    needed = list(modules)
    for module in needed:  # grows
        try:
            _import(module)
        except ImportError as error:
            raise ValueError(f"apps: cannot load {module!r} on {NAME}: {error}") from error
        app = manager.load_app(module)
        services = _handler.get_dependent_services(app) if app else []
        needed += [service for service in services if service not in needed]


def serve_on(
    host: str,
    port: int,
    rest: tuple[str, int] | None = None,
    rest_fd: int | None = None,
    echo_period_s: float = 1.0,
) -> None:
    """Set where switches connect, and how soon a silent one counts as gone.

    On native threads only the unanswered echo ends a connection that its switch closed.
    Ryu's WSGI serves on `rest`, which the stock apps may share; on that socket,
    if one is given that listens already.
    """
    if rest is not None:
        wsgi()
        if rest_fd is not None:
            _adopt(rest, rest_fd)
    cfg.CONF(args=[], project="qmn", default_config_files=[])
    options = {
        "ofp_listen_host": host,
        "ofp_tcp_listen_port": port,
        "echo_request_interval": echo_period_s,
        "maximum_unreplied_echo_requests": 10,
    }
    if rest is not None:
        options |= {"wsapi_host": rest[0], "wsapi_port": rest[1]}
    if "observe_links" in cfg.CONF:  # of topology.switches, which finds no links without it
        options["observe_links"] = True
    for option, value in options.items():
        cfg.CONF.set_override(option, value)


def shows_life(datapath: Datapath) -> None:
    """Note that a switch works on what it was sent, behind which echoes wait for their turn."""
    datapath.unreplied_echo_requests.clear()


def _adopt(address: tuple[str, int], descriptor: int) -> None:
    """Let eventlet, which Ryu's WSGI listens by, take this socket for the address."""
    listen, green_socket = hub.eventlet.listen, hub.eventlet.greenio.GreenSocket

    def adopted(place: tuple[str, int], *arguments: Any, **options: Any) -> Any:
        if tuple(place) != address:
            return listen(place, *arguments, **options)
        return green_socket(socket.socket(fileno=descriptor))

    hub.eventlet.listen = adopted


def start(
    modules: list[str], guard: Callable[[Any], Any] = lambda served: served, **contexts: Any
) -> dict[str, Any]:
    """Start the apps of the given modules and the OpenFlow server; return apps by name.

    All HTTP requests pass the guard, a WSGI application.
    """
    manager = app_manager.AppManager.get_instance()
    manager.load_apps(modules)
    manager.instantiate_apps(**manager.create_contexts(), **contexts)
    server = wsgi().start_service(manager) if wsgi.cache_info().currsize else None
    if server is not None:
        server.handle = guard(server.handle)
        server.server = SharedAccept(server.server, hub.sleep)
        hub.spawn(server)
    return dict(manager.applications)
