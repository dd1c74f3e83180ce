"""The backends by name, and how states that they hold come together."""

from dispatcher.sabot.backend import Backend, Begin
from dispatcher.sabot.bit_columns import BitColumns
from dispatcher.sabot.dense import Dense
from dispatcher.sabot.stim_state import StimState
from dispatcher.sabot.tableau import Tableau


class Chp:
    """The tableau of Aaronson and Gottesman, in whichever form suits the number of members."""

    NAME = Tableau.NAME

    def __call__(self, qubits: int, members: int, /) -> Backend:
        return BitColumns(qubits) if members == 1 else Tableau(qubits, members)


BACKENDS: dict[str, Begin] = {"chp": Chp(), "stim": StimState, "dense": Dense}


def tensor(one: Backend, other: Backend) -> Backend:
    """Return the joint state of both; the other's qubits follow the one's."""
    if type(one) is not type(other):
        convert = as_dense if Dense in (type(one), type(other)) else _as_tableau
        one, other = convert(one), convert(other)
    return one.tensor(other)


def as_dense(state: Backend) -> Dense:
    return state if isinstance(state, Dense) else Dense.from_stabilizers(state)


def _as_tableau(state: Backend) -> Backend:
    return state.as_tableau() if isinstance(state, BitColumns) else state
