"""Messages of several blocks over one connection: each is heard by whom it is for, in order."""

from collections.abc import Iterator

import pytest

from hosts.middleware.session.errors import SessionError
from hosts.middleware.session.mailbox import MAX_KEPT, Mailbox, Wanted
from hosts.middleware.session.values import values
from wire.metadata.blocks import Emit, Finish, Report
from wire.metadata.header import Message
from wire.metadata.setup import Answer
from wire.metadata.values import Envelope, Topic, Values
from wire.metadata.vocabulary import Reason

SESSION = 5


def topic_values(topic: int, block: int, *numbers: int) -> Values:
    return values(SESSION, topic, block, numbers, 32)


def of_block(block: int) -> list[Message]:
    return [
        topic_values(Topic.COMING, block, 8),
        topic_values(Topic.SWAPPED, block, 1),
        topic_values(Topic.PURIFY, block),
    ]


def interleavings(left: dict[int, int]) -> Iterator[list[int]]:
    """Yield every order of blocks that have a number of messages each."""
    if not any(left.values()):
        yield []
    for block, count in left.items():
        if count:
            for rest in interleavings(left | {block: count - 1}):
                yield [block, *rest]


@pytest.mark.parametrize("asked", [(1, 2, 3), (3, 2, 1), (2, 1, 3)])
def test_messages_of_three_blocks_come_to_them_in_order_however_they_are_mixed(
    asked: tuple[int, ...],
) -> None:
    orders = list(interleavings({1: 3, 2: 3, 3: 3}))
    assert len(orders) == 1680  # 9! / (3!)^3
    for order in orders:
        box, left = Mailbox(), {block: of_block(block) for block in asked}
        for block in order:
            box.put(left[block].pop(0))
        for block in asked:
            assert [box.take(Wanted(block)) for _ in range(3)] == of_block(block)
            assert not box.has(Wanted(block))
        assert not box.has(Wanted())


def test_who_waits_for_a_block_that_begins_leaves_the_news_of_others() -> None:
    box = Mailbox()
    for message in (
        *of_block(1)[:2],
        topic_values(Topic.COMING, 2, 8),
        Finish(SESSION, 0, bytes(32)),
    ):
        box.put(message)
    assert box.take(Wanted(begins=True)) == topic_values(Topic.COMING, 1, 8)
    assert box.take(Wanted(begins=True)) == topic_values(Topic.COMING, 2, 8)
    assert isinstance(box.take(Wanted(begins=True)), Finish)
    assert not box.has(Wanted(begins=True))
    assert box.take(Wanted(1)) == topic_values(Topic.SWAPPED, 1, 1)


def test_who_follows_takes_what_comes_whatever_it_is_about() -> None:
    box = Mailbox()
    coming = [*of_block(1), *of_block(2)]
    for message in coming:
        box.put(message)
    assert [box.take(Wanted()) for _ in coming] == coming


def test_who_follows_leaves_blocks_that_others_hear_of() -> None:
    box = Mailbox()
    for message in (*of_block(1), *of_block(2)):
        box.put(message)
    assert [box.take(Wanted(apart={1})) for _ in range(3)] == of_block(2)
    assert not box.has(Wanted(apart={1}))
    assert box.take(Wanted(1)) == of_block(1)[0]


def test_values_of_a_block_that_nobody_has_announced_are_refused() -> None:
    box = Mailbox()
    box.receive(topic_values(Topic.COMING, 1, 8))  # this end has
    box.put(topic_values(Topic.ARRIVED, 1))
    with pytest.raises(SessionError, match="block 2, which nobody has announced"):
        box.put(topic_values(Topic.ARRIVED, 2))


@pytest.mark.parametrize(
    "message", [Emit(SESSION, 1, 10, 1000), Report(SESSION, 9, 10), Envelope(SESSION, 1, b"x")]
)
def test_what_nobody_asks_for_while_blocks_are_under_way_is_refused_at_once(
    message: Message,
) -> None:
    with pytest.raises(SessionError, match=f"{type(message).__name__} between blocks"):
        Mailbox().put(message)


@pytest.mark.parametrize("last", [None, Answer(SESSION, Reason.HARDWARE, "gone")])
def test_everybody_hears_of_the_end_behind_what_came_before(last: Answer | None) -> None:
    box = Mailbox()
    box.put(topic_values(Topic.COMING, 1, 8))
    box.put(last)
    assert box.take(Wanted(1)) == topic_values(Topic.COMING, 1, 8)
    for block in (1, 2, None):
        assert box.has(Wanted(block))
        assert box.take(Wanted(block)) == last


def test_more_messages_than_are_kept_end_the_connection() -> None:
    box = Mailbox()
    for _message in range(MAX_KEPT):
        box.put(topic_values(Topic.COMING, 1, 8))
    with pytest.raises(SessionError, match="that nobody waits for"):
        box.put(topic_values(Topic.COMING, 1, 8))
