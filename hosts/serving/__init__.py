"""Serving the applications at the stack's socket, and hosts that call."""
