"""Circuits as users write them: read from OpenQASM 2.0 or `.chp`, and run on any backend."""
