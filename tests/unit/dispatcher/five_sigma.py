"""The bound of the statistical tests: 5 standard errors, with a fixed seed."""


def within(found: float, count: int, probability: float) -> bool:
    """Return whether `found` of `count` is what a probability lets expect."""
    sigma = (count * probability * (1 - probability)) ** 0.5
    return bool(abs(found - count * probability) <= 5 * sigma)
