"""The handler of each operation, which a host asks for alone or as a step of an order."""

from collections.abc import Awaitable, Callable
from typing import Any

from dispatcher.layer.layer import PhysicalLayer, block_name
from dispatcher.operations.blocks import Operations
from dispatcher.operations.gathering import Gathering
from dispatcher.operations.heralding import Heralding
from dispatcher.operations.imperfections import over
from dispatcher.operations.looking import Telling
from dispatcher.operations.measurements import Measurements
from dispatcher.operations.resending import Resending
from dispatcher.operations.sensing import sense as take_phase
from dispatcher.operations.splitting import Splitting
from dispatcher.operations.transport import Transport
from dispatcher.refusal import invalid
from wire import dispatcher_pb2 as messages
from wire.optical import DEFAULT_FREQUENCY_MHZ

Handler = Callable[[str, Any], Awaitable[messages.Feedback]]


def operation_handlers(
    layer: PhysicalLayer,
    operations: Operations,
    measurements: Measurements,
    transport: Transport,
    gathering: Gathering,
    resending: Resending,
    splitting: Splitting,
    heralding: Heralding,
    telling: Telling,
) -> dict[str, Handler]:
    """Return the handler of each operation of a Step, called with node and request."""

    async def create(node: str, request: messages.CreateRequest) -> messages.Feedback:
        return await over(layer, node, operations.create(node, request))

    async def apply(node: str, request: messages.ApplyRequest) -> messages.Feedback:
        return await over(layer, node, operations.apply(node, request))

    async def send(node: str, request: messages.SendRequest) -> messages.Feedback:
        launches = [(block_name(launch.block), launch.port) for launch in request.launches]
        frequency_mhz = request.frequency_mhz or DEFAULT_FREQUENCY_MHZ
        return await transport.send(node, launches, request.rate_hz, frequency_mhz)

    async def receive(node: str, request: messages.ReceiveRequest) -> messages.Feedback:
        name = block_name(request.block)
        return await transport.receive(node, name, request.port, request.timeout_s)

    async def measure(node: str, request: messages.MeasureRequest) -> messages.Feedback:
        name = block_name(request.block)
        return await over(layer, node, measurements.measure(node, name, request))

    async def bell_measure(node: str, request: messages.BellMeasureRequest) -> messages.Feedback:
        names = block_name(request.first), block_name(request.second)
        return await over(layer, node, measurements.bell_measure(node, names, request.packed))

    async def store(node: str, request: messages.StoreRequest) -> messages.Feedback:
        told = request.cutoff_s if request.HasField("cutoff_s") else None
        return operations.store(node, block_name(request.block), told)

    async def discard(node: str, request: messages.DiscardRequest) -> messages.Feedback:
        if request.HasField("block") == bool(request.session):
            raise invalid("name either a block or a session that is not 0")
        if request.session:
            heralding.forget(node, request.session)
            return operations.discard_session(node, request.session)
        return operations.discard(node, block_name(request.block))

    async def gather(node: str, request: messages.GatherRequest) -> messages.Feedback:
        into = block_name(request.into)
        return gathering.gather(node, into, request.picks, request.keep_rest)

    async def resend(node: str, request: messages.ResendRequest) -> messages.Feedback:
        told = resending.resend(node, block_name(request.block), request.bases)
        return await over(layer, node, told)

    async def attempt(node: str, request: messages.AttemptRequest) -> messages.Feedback:
        frequency_mhz = request.frequency_mhz or DEFAULT_FREQUENCY_MHZ
        told = request.cutoff_s if request.HasField("cutoff_s") else None
        name = block_name(request.block)
        return heralding.attempt(node, name, request.port, frequency_mhz, told)

    async def herald(node: str, request: messages.HeraldRequest) -> messages.Feedback:
        return await heralding.herald(node, request)

    async def split(node: str, request: messages.SplitRequest) -> messages.Feedback:
        return splitting.split(node, block_name(request.block), block_name(request.into))

    async def tell(node: str, request: messages.TellRequest) -> messages.Feedback:
        return telling.tell(node, request)

    async def sense(node: str, request: messages.SenseRequest) -> messages.Feedback:
        return take_phase(layer, node, block_name(request.block))

    return {
        "create": create,
        "apply": apply,
        "send": send,
        "receive": receive,
        "measure": measure,
        "bell_measure": bell_measure,
        "store": store,
        "discard": discard,
        "gather": gather,
        "resend": resend,
        "attempt": attempt,
        "herald": herald,
        "split": split,
        "tell": tell,
        "sense": sense,
    }
