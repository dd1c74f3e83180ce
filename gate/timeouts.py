"""The waits of the gate: seconds of the wall clock."""

PAUSE_S = 1e-4  # between two looks while programs run
HELD_S = 30.0  # until the gate says what lets the clock stand
