"""The report of a run: what it read, what it draws, the page."""
