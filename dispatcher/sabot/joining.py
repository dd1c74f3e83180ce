"""Brings the qubits of two registers together, position by position, into shared components.

    register A   0 1 2 3 4 5         component 1: pairs (A 0, B 4) (A 1, B 0) ...
    register B   0 1 2 3 4 5

Where two qubits that are to meet belong to the same component already, but to different members
of it, members that hang together become one: the pairs of A and B in the picture do if A and B meet
again, and form rings. How large such a system may be is decided before (dispatcher.sabot.capacity).
"""

import numpy as np
from numpy.typing import NDArray

from dispatcher.sabot.backends import tensor
from dispatcher.sabot.registers import Component, Positions, Register, Share, Store

Pairs = list[tuple[Share, Share]]
Members = NDArray[np.intp]


def join(store: Store, first: Register, second: Register) -> Pairs:
    """Make the qubits at every position that both registers cover share one component.

    Return the shares that are at the same positions of either register, as the same members.
    """
    pairs = _joined(first, second)
    while pairs is None:
        _match(store, first, second)
        pairs = _merge_all(store, first, second)
    return pairs


def same(one: Positions, other: Positions) -> bool:
    if isinstance(one, slice) or isinstance(other, slice):
        return isinstance(one, slice) and isinstance(other, slice)
    return one is other or np.array_equal(one, other)


def _joined(first: Register, second: Register) -> Pairs | None:
    """Return the pairs of shares if all are joined already, as blocks of pairs are."""
    if len(first.shares) == len(second.shares) == 1:
        (share,), (other,) = first.shares, second.shares
        return [(share, other)] if _place(share) == _place(other) else None
    theirs = {_place(share): share for share in second.shares}
    ours = {_place(share): share for share in first.shares}
    if ours.keys() != theirs.keys():
        return None
    return [(share, theirs[place]) for place, share in ours.items()]


def _place(share: Share) -> tuple[Component, int]:
    positions = share.positions
    return share.component, -1 if isinstance(positions, slice) else id(positions)


def _match(store: Store, first: Register, second: Register) -> None:
    """Divide until shares with a position in common have all of them in common."""
    while store.divide(first, second.labels()) | store.divide(second, first.labels()):
        pass


def _merge_all(store: Store, first: Register, second: Register) -> Pairs | None:
    """Merge the components of matching shares; return None if some had to be divided again."""
    theirs, labels = list(second.shares), second.labels()
    pairs: Pairs | None = []
    for share in list(first.shares):
        label = int(labels[share.first]) if share in first.shares else -1
        if label < 0 or theirs[label] not in second.shares:
            continue
        other = theirs[label]
        if share.component is not other.component:
            _merge(store, share, other, first.size)
        elif not same(share.positions, other.positions):
            steps = _members(other.positions, share.positions, first.size)
            store.split(share.component, _rings(steps))
            pairs = None
        else:
            store.move(other, share.positions)
        if pairs is not None:
            pairs.append((share, other))
    return pairs


def _merge(store: Store, share: Share, other: Share, size: int) -> None:
    """Let the components of two shares that are at the same positions be one."""
    one, two = share.component, other.component
    store.unlink(one)
    store.unlink(two)
    if same(share.positions, other.positions):
        state = two.state
    else:
        members = _members(other.positions, share.positions, size)
        ordered = two.take(members)
        state = ordered.state
        for share_before, moved in zip(two.shares, ordered.shares, strict=True):
            share_before.positions = moved.positions
    before = other.positions
    for share_before in two.shares:
        if share_before.positions is before:
            share_before.positions = share.positions
    store.link(Component(tensor(one.state, state), one.shares + two.shares))


def _members(positions: Positions, numbers: Positions, size: int) -> Members:
    if isinstance(positions, slice):
        return np.arange(size)[numbers]
    where = np.zeros(size, dtype=np.intp)
    where[positions] = np.arange(positions.size)
    return where[numbers]


def _rings(steps: Members) -> Members:
    """Label members so that no two of a ring have the same label: its length, and their place.

    From member m the ring goes on with steps[m].
    """
    start = np.arange(steps.size)
    lowest, here, lengths = start.copy(), steps, np.zeros_like(start)
    length = 1
    while (open_ := lengths == 0).any():
        lengths[open_ & (here == start)] = length
        np.minimum(lowest, here, out=lowest)
        here, length = steps[here], length + 1
    places, here = np.zeros_like(start), np.flatnonzero(lowest == start)
    for place in range(length - 1):
        here = here[lengths[here] > place]
        places[here] = place
        here = steps[here]
    return lengths * length + places
