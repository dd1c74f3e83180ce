"""Sabot in a process of its own: its gRPC service, and the manager that calls it."""
