"""Processes of a run: each started, watched and ended by its own handle."""
