"""Questions about the reference key as messages, and back."""

import numpy as np

from hosts.middleware.qkd.parities import Blocks, Intervals, Query, Syndrome
from wire.qkd import AskBlocks, AskIntervals, AskSyndrome, QkdMessage


def to_message(query: Query) -> QkdMessage:
    """Return the message that asks a question."""
    if isinstance(query, Blocks):
        return AskBlocks(query.first, query.passes, query.size)
    if isinstance(query, Syndrome):
        return AskSyndrome(query.checks)
    starts = query.starts.astype(">u4").tobytes()
    widths = (query.stops - query.starts).astype(">u2").tobytes()
    return AskIntervals(query.number, query.starts.size, starts, widths)


def to_query(message: AskBlocks | AskIntervals | AskSyndrome) -> Query:
    """Return the question that a message asks."""
    if isinstance(message, AskBlocks):
        return Blocks(message.first, message.passes, message.size)
    if isinstance(message, AskSyndrome):
        return Syndrome(message.checks)
    starts = np.frombuffer(message.starts, dtype=">u4").astype(np.int64)
    widths = np.frombuffer(message.widths, dtype=">u2").astype(np.int64)
    return Intervals(message.number, starts, starts + widths)
