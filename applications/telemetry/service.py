"""gNMI's service: Capabilities, Get and Subscribe of what a switch measures; nothing can be set.

Serves a switch's telemetry beside what the agent does.

The server of gRPC has a Unix socket: gRPC cannot be given a TCP socket that listens already.
"""

# gRPC names the methods.
# ruff: noqa: N802

import asyncio
import json
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import grpc
from pygnmi.spec.v080 import gnmi_pb2 as gnmi
from pygnmi.spec.v080.gnmi_pb2_grpc import add_gNMIServicer_to_server, gNMIServicer

from applications.telemetry.open_config import (
    MODELS,
    Element,
    Fiber,
    Large,
    Leaf,
    Observed,
    Path,
    Value,
    found,
    leaves,
)
from applications.timeouts import TELEMETRY_LEAST_S, TELEMETRY_PERIOD_S
from programs.connection_shares import StreamServer, grpc_options
from programs.metrics import inherited
from programs.relay import relay
from qswitch_agent.hardware.optics import HardwareFault
from qswitch_agent.switch import Switch
from wire.config import AgentConfig, BadConfig
from wire.network_time import REAL_TIME, NetworkTime

VERSION = "0.8.0"
ENCODINGS = (gnmi.JSON, gnmi.JSON_IETF, gnmi.PROTO)
DIGITS = 3  # of numbers with a fraction
MAX_ELEMENTS = 32


class Unusable(Exception):
    """A request that cannot be answered; the text names what, and what can be."""


def path_of(prefix: Any, path: Any) -> Path:
    """Return the path of a request, behind its prefix; raise Unusable for anything else."""
    elements = [*prefix.elem, *path.elem]
    if path.element or prefix.element:
        raise Unusable("the path is in `element`, of gNMI before 0.4: use `elem`")
    if len(elements) > MAX_ELEMENTS:
        raise Unusable(f"a path of {len(elements)} elements: at most {MAX_ELEMENTS}")
    return tuple(Element(element.name, tuple(sorted(element.key.items()))) for element in elements)


def require_encoding(encoding: int) -> None:
    if encoding not in ENCODINGS:
        names = ", ".join(map(gnmi.Encoding.Name, ENCODINGS))
        raise Unusable(f"encoding {encoding}: choose one of {names}")


def notification(
    time_ns: int, leaves: Iterable[Leaf], encoding: int, gone: Sequence[Path] = ()
) -> Any:
    updates = [
        gnmi.Update(path=_encoded(leaf.path), val=_typed(leaf.value, encoding)) for leaf in leaves
    ]
    return gnmi.Notification(
        timestamp=time_ns, update=updates, delete=[_encoded(path) for path in gone]
    )


def _encoded(path: Path) -> Any:
    return gnmi.Path(elem=[gnmi.PathElem(name=name, key=dict(keys)) for name, keys in path])


def _typed(value: Value, encoding: int) -> Any:
    if encoding == gnmi.PROTO:
        if isinstance(value, str):
            return gnmi.TypedValue(string_val=value)
        if isinstance(value, int):
            return gnmi.TypedValue(uint_val=value)
        return gnmi.TypedValue(double_val=value)
    if encoding == gnmi.JSON_IETF:
        if isinstance(value, float):
            value = f"{value:.{DIGITS}f}"
        elif isinstance(value, Large):
            value = str(value)
        return gnmi.TypedValue(json_ietf_val=json.dumps(value).encode())
    return gnmi.TypedValue(json_val=json.dumps(value).encode())


MAX_PATHS = 256  # of a request
MAX_STREAMS = 32  # at a time

Observe = Callable[[], Awaitable[list[Leaf]]]


@dataclass
class Followed:
    """One subscription of a stream: its period, and the values sent last."""

    path: Path
    period_s: float
    changes_only: bool
    due_s: float = 0.0
    sent: dict[Path, Value] = field(default_factory=dict)

    def news(self, leaves: list[Leaf]) -> tuple[list[Leaf], list[Path]]:
        now = {leaf.path: leaf.value for leaf in found(leaves, self.path)}
        gone = [path for path in self.sent if path not in now]
        before, self.sent = self.sent, now
        if self.changes_only:
            now = {path: value for path, value in now.items() if before.get(path) != value}
        return [Leaf(path, value) for path, value in now.items()], gone


class Telemetry(gNMIServicer):  # type: ignore[misc]
    def __init__(self, observe: Observe, network_time: NetworkTime = REAL_TIME) -> None:
        self._observe, self._time = observe, network_time
        self._streams = 0

    async def Capabilities(self, _request: Any, _context: Any) -> Any:
        models = [gnmi.ModelData(**model._asdict()) for model in MODELS]
        return gnmi.CapabilityResponse(
            supported_models=models, supported_encodings=ENCODINGS, gNMI_version=VERSION
        )

    async def Get(self, request: Any, context: Any) -> Any:
        """Return what is at paths now; NOT_FOUND where there is nothing at one."""
        try:
            require_encoding(request.encoding)
            paths = self._paths(request.prefix, request.path)
        except Unusable as error:
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, str(error))
        try:
            leaves, notifications = await self._observe(), list[Any]()
        except HardwareFault as fault:
            await context.abort(grpc.StatusCode.UNAVAILABLE, str(fault))
        of_state = request.type != gnmi.GetRequest.CONFIG
        for requested, path in zip(request.path or [gnmi.Path()], paths, strict=True):
            here = found(leaves, path)
            if not here:
                text = f"there is nothing at {'/'.join(element.name for element in requested.elem)}"
                await context.abort(grpc.StatusCode.NOT_FOUND, text)
            sent = here if of_state else []
            notifications.append(notification(self._time.stamp_ns(), sent, request.encoding))
        return gnmi.GetResponse(notification=notifications)

    async def Set(self, _request: Any, context: Any) -> Any:
        """Refuse: switches are set by OpenFlow."""
        text = "nothing can be set by gNMI: tune ports and connect them by OpenFlow"
        await context.abort(grpc.StatusCode.UNIMPLEMENTED, text)

    async def Subscribe(self, requests: AsyncIterator[Any], context: Any) -> AsyncIterator[Any]:
        """Tell what is at paths once, at each poll, or as time passes."""
        if self._streams >= MAX_STREAMS:
            await context.abort(
                grpc.StatusCode.RESOURCE_EXHAUSTED, f"{MAX_STREAMS} subscriptions are open"
            )
        self._streams += 1
        try:
            async for response in self._told(requests):
                yield response
        except Unusable as error:
            await context.abort(grpc.StatusCode.INVALID_ARGUMENT, str(error))
        except HardwareFault as fault:
            await context.abort(grpc.StatusCode.UNAVAILABLE, str(fault))
        finally:
            self._streams -= 1

    async def _told(self, requests: AsyncIterator[Any]) -> AsyncIterator[Any]:
        first = await anext(requests, None)
        if first is None or not first.HasField("subscribe"):
            raise Unusable("a subscription begins with `subscribe`")
        subscriptions = first.subscribe
        require_encoding(subscriptions.encoding)
        followed = self._followed(subscriptions)
        if subscriptions.mode == gnmi.SubscriptionList.POLL:
            async for request in requests:
                if not request.HasField("poll"):
                    raise Unusable("after `subscribe` a subscription by polls has polls alone")
                async for response in self._all(followed, subscriptions):
                    yield response
            return
        async for response in self._all(followed, subscriptions):
            yield response
        while subscriptions.mode == gnmi.SubscriptionList.STREAM:
            await asyncio.sleep(
                min(subscription.due_s for subscription in followed) - time.monotonic()
            )
            for response in await self._due(followed, subscriptions.encoding):
                yield response

    async def _all(self, followed: list[Followed], subscriptions: Any) -> AsyncIterator[Any]:
        for response in await self._due(followed, subscriptions.encoding, everything=True):
            if not subscriptions.updates_only:
                yield response
        yield gnmi.SubscribeResponse(sync_response=True)

    async def _due(
        self, followed: list[Followed], encoding: int, everything: bool = False
    ) -> list[Any]:
        leaves, now_s = await self._observe(), time.monotonic()
        responses = []
        for subscription in followed:
            if everything:
                subscription.sent.clear()
            elif subscription.due_s > now_s:
                continue
            subscription.due_s = now_s + subscription.period_s
            news, gone = subscription.news(leaves)
            if news or gone:
                update = notification(self._time.stamp_ns(), news, encoding, gone)
                responses.append(gnmi.SubscribeResponse(update=update))
        return responses

    def _followed(self, subscriptions: Any) -> list[Followed]:
        requested = subscriptions.subscription
        paths = self._paths(subscriptions.prefix, [subscription.path for subscription in requested])
        if not requested:
            raise Unusable("a subscription without paths: name one")
        return [
            Followed(
                path,
                _period_s(subscription),
                subscription.mode != gnmi.SAMPLE or subscription.suppress_redundant,
            )
            for path, subscription in zip(paths, requested, strict=True)
        ]

    @staticmethod
    def _paths(prefix: Any, paths: Any) -> list[Path]:
        if len(paths) > MAX_PATHS:
            raise Unusable(f"{len(paths)} paths: at most {MAX_PATHS} in a request")
        return [path_of(prefix, path) for path in paths or [gnmi.Path()]]


def _period_s(subscription: Any) -> float:
    """Return how often a subscription is looked at; raise Unusable for what is too often."""
    if subscription.mode != gnmi.SAMPLE or not subscription.sample_interval:
        return TELEMETRY_PERIOD_S
    period_s: float = subscription.sample_interval / 1e9
    if period_s < TELEMETRY_LEAST_S:
        raise Unusable(f"sample_interval {period_s:g} s: at least {TELEMETRY_LEAST_S:g} s")
    return period_s


MAX_REQUEST_BYTES = 1 << 18
OPTIONS = [("grpc.so_reuseport", 0), ("grpc.max_receive_message_length", MAX_REQUEST_BYTES)]


async def observe(switch: Switch, name: str) -> list[Leaf]:
    readings = await switch.read()
    fibers = {
        number: Fiber(port.name, port.up, switch.light(number, readings))
        for number, port in switch.described.items()
    }
    standing = [path for path in switch.paths.standing if {*path[:2]} <= fibers.keys()]
    return leaves(Observed(name, fibers, readings, standing, switch.path_optics()))


@asynccontextmanager
async def serving(config: AgentConfig, switch: Switch) -> AsyncIterator[None]:
    assert config.gnmi_fd is not None
    place = f"unix:{config.gnmi}"
    server = grpc.aio.server(options=[*OPTIONS, *grpc_options()])
    telemetry = Telemetry(partial(observe, switch, config.switch), config.time)
    add_gNMIServicer_to_server(telemetry, server)
    try:
        if config.credentials is None:
            server.add_insecure_port(place)
        else:
            authority, certificate, private_key = config.credentials.read()
            shown = [(private_key, certificate)]
            server.add_secure_port(place, grpc.ssl_server_credentials(shown, authority, True))
    except RuntimeError as error:
        raise BadConfig(f"cannot serve gNMI at {config.gnmi}: {error}") from error
    await server.start()
    connect = partial(asyncio.open_unix_connection, config.gnmi)
    entrance = StreamServer(lambda *near: relay(connect, near), inherited(config.gnmi_fd))
    try:
        yield
    finally:
        entrance.close()
        await server.stop(0)
