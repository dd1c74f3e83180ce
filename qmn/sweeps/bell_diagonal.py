"""Theory of Bell-diagonal pairs: probabilities of Phi+, Psi+, Phi- and Psi-, which add up to 1."""

Bell = tuple[float, float, float, float]


def werner(fidelity: float) -> Bell:
    """Return a Werner pair."""
    wrong = (1 - fidelity) / 3
    return fidelity, wrong, wrong, wrong


def swapped(one: Bell, other: Bell) -> Bell:
    """Return what a perfect swap makes of two pairs: their Pauli errors, multiplied."""
    first, second, third, fourth = (
        sum(one[error] * other[error ^ state] for error in range(4)) for state in range(4)
    )
    return first, second, third, fourth


def purified(pair: Bell) -> Bell:
    """Return what a round of DEJMPS makes of two pairs alike (Phys. Rev. Lett. 77, 2818, eq. 3)."""
    phi, psi, phi_minus, psi_minus = pair
    success = (phi + psi_minus) ** 2 + (psi + phi_minus) ** 2
    return (
        (phi**2 + psi_minus**2) / success,
        (psi**2 + phi_minus**2) / success,
        2 * phi * psi_minus / success,
        2 * psi * phi_minus / success,
    )


def nested(fidelity: float, levels: int, rounds: int) -> float:
    """Return the fidelity of 2^levels Werner links joined two by two, purified before each swap.

    Briegel, Duer, Cirac and Zoller, Phys. Rev. Lett. 81, 5932.
    """
    pair = werner(fidelity)
    for _level in range(levels):
        for _round in range(rounds):
            pair = purified(pair)
        pair = swapped(pair, pair)
    return pair[0]
