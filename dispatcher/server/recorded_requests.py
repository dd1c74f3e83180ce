"""Requests that change more than qubits, by the names under which they are recorded.

Whatever a new request changes must be done by a name of this table, or it is not replayed.
"""

from collections.abc import Awaitable, Callable
from typing import Any

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.operations.adjustment import adjust
from dispatcher.operations.looking import look
from dispatcher.operations.switching import Switching
from wire import dispatcher_pb2 as messages

Change = Callable[[str, Any], Awaitable[Any]]

# What each recorded request is decoded as, those that operation_handlers does included.
REQUESTS: dict[str, type[Any]] = {
    "create": messages.CreateRequest,
    "apply": messages.ApplyRequest,
    "send": messages.SendRequest,
    "receive": messages.ReceiveRequest,
    "measure": messages.MeasureRequest,
    "bell_measure": messages.BellMeasureRequest,
    "store": messages.StoreRequest,
    "discard": messages.DiscardRequest,
    "gather": messages.GatherRequest,
    "resend": messages.ResendRequest,
    "attempt": messages.AttemptRequest,
    "herald": messages.HeraldRequest,
    "split": messages.SplitRequest,
    "tell": messages.TellRequest,
    "sense": messages.SenseRequest,
    "look": messages.LookRequest,
    "cross_connect": messages.CrossConnectRequest,
    "tune_port": messages.TunePortRequest,
    "inject_fault": messages.InjectFaultRequest,
    "adjust_fiber": messages.AdjustFiberRequest,
}


def changes(layer: PhysicalLayer, switching: Switching) -> dict[str, Change]:
    """Return what each change is, called with node and request."""

    async def cross_connect(_node: str, request: messages.CrossConnectRequest) -> int:
        return await switching.cross_connect(request.switch, request.connections)

    async def tune_port(_node: str, request: messages.TunePortRequest) -> int:
        return switching.tune(request)

    async def inject_fault(_node: str, request: messages.InjectFaultRequest) -> None:
        await switching.inject(request)

    async def looked(node: str, request: messages.LookRequest) -> messages.LookReply:
        return look(layer, node, request)

    async def adjust_fiber(_node: str, request: messages.AdjustFiberRequest) -> int:
        return adjust(layer, request)

    return {
        "adjust_fiber": adjust_fiber,
        "cross_connect": cross_connect,
        "tune_port": tune_port,
        "inject_fault": inject_fault,
        "look": looked,
    }
