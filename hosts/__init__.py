"""The stack of a quantum host: software, middleware and hardware layers."""
