"""The factors of a stabilizer state: qubits that are independent of all others.

The reduced row echelon form of a direct sum is that of its parts, so rows that share no
qubit in it belong to separate states (linear algebra over GF(2)).
"""

import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.bool_]


def eliminate(generators: Bits) -> tuple[Bits, list[tuple[int, int]]]:
    """Bring generators, shape (n, 2n), into reduced form up to the order of the rows.

    Return them and the steps: (row, by) stands for adding row `by` to `row`.
    """
    rows = generators.copy()
    steps: list[tuple[int, int]] = []
    free = np.ones(len(rows), dtype=bool)
    for column in range(rows.shape[1]):
        candidates = np.flatnonzero(rows[:, column] & free)
        if not candidates.size:
            continue
        pivot = int(candidates[0])
        free[pivot] = False
        others = np.flatnonzero(rows[:, column])
        others = others[others != pivot]
        rows[others] ^= rows[pivot]
        steps += [(int(row), pivot) for row in others]
    return rows, steps


def independent_groups(support: Bits) -> list[tuple[list[int], list[int]]]:
    """Group rows and qubits of support, shape (rows, qubits), that hang together.

    Return (rows, qubits) of each group, ordered by their first qubit.
    """
    groups: list[tuple[Bits, list[int]]] = []
    for row, touched in enumerate(support):
        rows, qubits = [row], touched.copy()
        apart = []
        for group_qubits, group_rows in groups:
            if (group_qubits & qubits).any():
                qubits |= group_qubits
                rows += group_rows
            else:
                apart.append((group_qubits, group_rows))
        groups = [*apart, (qubits, rows)]
    found = [(sorted(rows), np.flatnonzero(qubits).tolist()) for qubits, rows in groups]
    return sorted(found, key=lambda group: group[1])
