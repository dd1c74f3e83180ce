"""gNMI's service: Capabilities, Get and Subscribe of what a switch measures; nothing can be set."""

# gRPC names the methods.
# ruff: noqa: N802

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

import grpc
from pygnmi.spec.v080 import gnmi_pb2 as gnmi
from pygnmi.spec.v080.gnmi_pb2_grpc import gNMIServicer

from qswitch_agent.hardware.optics import HardwareFault
from qswitch_agent.telemetry.messages import (
    ENCODINGS,
    VERSION,
    Unusable,
    notification,
    path_of,
    require_encoding,
)
from qswitch_agent.telemetry.open_config import MODELS
from qswitch_agent.telemetry.tree import Leaf, Path, Value, found
from qswitch_agent.timeouts import TELEMETRY_LEAST_S, TELEMETRY_PERIOD_S

MAX_PATHS = 256  # of a request
MAX_STREAMS = 32  # at a time

Observe = Callable[[], Awaitable[list[Leaf]]]


@dataclass
class Followed:
    """One subscription of a stream: how often it is looked at, and what has been told of it."""

    path: Path
    period_s: float
    changes_only: bool
    due_s: float = 0.0
    told: dict[Path, Value] = field(default_factory=dict)

    def news(self, leaves: list[Leaf]) -> tuple[list[Leaf], list[Path]]:
        now = {leaf.path: leaf.value for leaf in found(leaves, self.path)}
        gone = [path for path in self.told if path not in now]
        before, self.told = self.told, now
        if self.changes_only:
            now = {path: value for path, value in now.items() if before.get(path) != value}
        return [Leaf(path, value) for path, value in now.items()], gone


class Telemetry(gNMIServicer):  # type: ignore[misc]
    """Answers operators' programs."""

    def __init__(self, observe: Observe) -> None:
        self._observe = observe
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
            told = here if of_state else []
            notifications.append(notification(time.time_ns(), told, request.encoding))
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
        """Tell all that there is, and that this was all."""
        for response in await self._due(followed, subscriptions.encoding, everything=True):
            if not subscriptions.updates_only:
                yield response
        yield gnmi.SubscribeResponse(sync_response=True)

    async def _due(
        self, followed: list[Followed], encoding: int, everything: bool = False
    ) -> list[Any]:
        """Return what is to be told of what it is time for."""
        leaves, now_s = await self._observe(), time.monotonic()
        responses = []
        for subscription in followed:
            if everything:
                subscription.told.clear()
            elif subscription.due_s > now_s:
                continue
            subscription.due_s = now_s + subscription.period_s
            news, gone = subscription.news(leaves)
            if news or gone:
                update = notification(time.time_ns(), news, encoding, gone)
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
