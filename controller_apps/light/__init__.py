"""The optical network as discovered, and the light paths through it."""
