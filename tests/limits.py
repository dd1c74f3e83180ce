"""How long tests wait before they say that something hangs; no statement about how long it takes.

Machines that run tests are shared, and may be several times slower than this one was an hour ago.
"""

PROGRAM_S = 280.0  # for a program that builds a network and does something in it
SOON_S = 120.0  # for what takes seconds where nothing else runs
