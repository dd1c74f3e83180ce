"""A noise model of a user's own, which no contract test runs."""

from dispatcher.fiber.noise import Effect, Passage


class Model:
    """Changes nothing."""

    def __init__(self, flip: float = 0.0) -> None: ...

    def effect(self, _passage: Passage) -> Effect:
        """Leave photons as they are."""
        return Effect()
