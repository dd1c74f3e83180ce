"""The requests that change the physical layer: one row each, with its message and its handler.

Hosts request operations as steps of an order; agents and the runner request the rest. A request is
recorded, and replayed, by the name of its row. To add an operation: docs/architecture.md.
"""

from collections.abc import Callable
from inspect import isawaitable
from typing import Any, NamedTuple

from google.protobuf.message import Message

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.layer.ownership import BlockName
from dispatcher.operations.adjustment import adjust, compensate
from dispatcher.operations.analysers import Analysers, Reports, Tasks
from dispatcher.operations.blocks import Operations
from dispatcher.operations.eavesdropping import Resending, Splitting
from dispatcher.operations.gathering import Gathering
from dispatcher.operations.heralding import Heralding
from dispatcher.operations.imperfections import over
from dispatcher.operations.measurements import Measurements
from dispatcher.operations.purification import Purification
from dispatcher.operations.state_inspection import look, sense, tell
from dispatcher.operations.stations import Stations
from dispatcher.operations.switch_memories import SwitchMemories
from dispatcher.operations.switching import Emission, Switching
from dispatcher.operations.transport import Transport
from dispatcher.refusal import invalid
from wire import dispatcher_pb2 as messages

Handler = Callable[[str, Any], Any]  # called with node and request


class Row(NamedTuple):
    message: type[Message]
    handler: Handler

    @property
    def has_time(self) -> bool:
        """Whether the request says when its order came."""
        return "asked_ns" in self.message.DESCRIPTOR.fields_by_name


class RequestTable:
    def __init__(self, layer: PhysicalLayer, failed: Callable[[BaseException], None]) -> None:
        """Call `failed` with an error of what goes on after a request, such as a flight."""
        self.layer = layer
        self.heralding = Heralding(layer, failed, self._came)
        self.blocks = Operations(layer)
        measurements = Measurements(layer)
        network, tasks = layer.network, Tasks(layer, failed)
        self.reports = Reports(network)
        self.analysers = Analysers(layer, measurements, self.reports, tasks)
        self.stations = Stations(layer, self.heralding, self.reports, tasks)
        self.transport = Transport(layer, failed, self._came)
        self.memories = SwitchMemories(
            layer,
            self.transport,
            self.analysers,
            self.reports,
            Purification(layer, self.blocks, measurements),
            tasks,
        )
        self.switching = Switching(layer, self._connected, self.memories.opened, self._part_failed)
        emission = Emission(layer, self.blocks, self.transport, self.stations.emit, tasks)
        self.rows = self._rows(measurements, emission)

    def _rows(self, measurements: Measurements, emission: Emission) -> dict[str, Row]:
        layer = self.layer
        return {
            "create": Row(messages.CreateRequest, self._timed(self.blocks.create)),
            "apply": Row(messages.ApplyRequest, self._timed(self.blocks.apply)),
            "send": Row(messages.SendRequest, self.transport.send),
            "receive": Row(messages.ReceiveRequest, self.transport.receive),
            "measure": Row(messages.MeasureRequest, self._timed(measurements.measure)),
            "bell_measure": Row(
                messages.BellMeasureRequest, self._timed(measurements.bell_measure)
            ),
            "store": Row(messages.StoreRequest, self.blocks.store),
            "discard": Row(messages.DiscardRequest, self._discard),
            "gather": Row(messages.GatherRequest, Gathering(layer).gather),
            "resend": Row(messages.ResendRequest, self._timed(Resending(layer).resend)),
            "attempt": Row(messages.AttemptRequest, self.stations.attempt),
            "split": Row(messages.SplitRequest, Splitting(layer).split),
            "tell": Row(messages.TellRequest, self._on_layer(tell)),
            "sense": Row(messages.SenseRequest, self._on_layer(sense)),
            "compensate": Row(messages.CompensateRequest, self._on_layer(compensate)),
            # not steps of an order
            "look": Row(messages.LookRequest, self._on_layer(look)),
            "cross_connect": Row(messages.CrossConnectRequest, self.switching.cross_connect),
            "emit": Row(messages.EmitRequest, emission.emit),
            "keep": Row(messages.KeepRequest, self.memories.keep),
            "tune_port": Row(messages.TunePortRequest, self.switching.tune),
            "inject_fault": Row(messages.InjectFaultRequest, self.switching.inject),
            "adjust_fiber": Row(messages.AdjustFiberRequest, self._on_layer(adjust)),
            "adjust_memory": Row(messages.AdjustMemoryRequest, self.switching.adjust_memory),
        }

    async def handle(self, node: str, name: str, request: Any) -> Any:
        """Return the reply to a node's request; raise Refusal if it is not possible."""
        reply = self.rows[name].handler(node, request)
        return await reply if isawaitable(reply) else reply

    def _came(self, name: BlockName) -> None:
        self.analysers.look(name)
        self.memories.look(name)

    def _connected(self, switch: str, outputs: set[int]) -> None:
        self.analysers.close(switch, outputs)
        self.stations.close(switch, outputs)
        self.memories.close(switch)

    def _part_failed(self, node: str) -> None:
        self.analysers.fail(node)
        self.stations.fail(node)
        self.memories.fail(node)

    def _on_layer(self, handler: Callable[[PhysicalLayer, str, Any], Any]) -> Handler:
        return lambda node, request: handler(self.layer, node, request)

    def _timed(self, handler: Handler) -> Handler:
        return lambda node, request: over(self.layer, node, handler(node, request))

    def _discard(self, node: str, request: messages.DiscardRequest) -> messages.Feedback:
        if request.HasField("block") == bool(request.session):
            raise invalid("name either a block or a session that is not 0")
        if request.session:
            self.stations.forget(node, request.session)
            return self.blocks.discard_session(node, request.session)
        return self.blocks.discard(node, request.block)
