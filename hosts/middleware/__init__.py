"""Middleware layer: from bytes to what the hardware does, and back."""
