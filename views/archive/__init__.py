"""Runs that are over: an index of them, two side by side, one as a file."""
