"""Telemetry of a quantum switch for operators: OpenConfig over gNMI."""
