"""The waits of the gate: seconds of the wall clock."""

PAUSE_S = 1e-4  # between two looks while programs run, at first, and doubled
LONGEST_PAUSE_S = 4e-3
HELD_S = 30.0  # until the gate says what lets the clock stand
