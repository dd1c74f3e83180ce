"""What hosts tell of themselves to those who watch: the instructions of a processing unit."""

from dispatcher.layer.layer import PhysicalLayer
from dispatcher.refusal import invalid
from wire.dispatcher_pb2 import Feedback, TellRequest

MOST = 4000  # characters


class Telling:
    """Records what hosts say; nothing of it is checked but its form."""

    def __init__(self, layer: PhysicalLayer) -> None:
        self._layer = layer

    def tell(self, node: str, request: TellRequest) -> Feedback:
        """Record a subroutine; refuse a text that would not be one line of a log."""
        text = request.text
        if not 0 < len(text) <= MOST or not (text.isascii() and text.isprintable()):
            shown = text[:20]
            raise invalid(f"text {shown!r}: 1 to {MOST} printable ASCII characters are told")
        self._layer.record(node, "subroutine", detail=text)
        return Feedback(time_ns=self._layer.clock.now_ns(), exact=True)
