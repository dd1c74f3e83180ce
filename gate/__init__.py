"""Steps the time of a network: the clock stands while a program runs, then leaps."""
