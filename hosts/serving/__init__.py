"""What the stack gives to the applications at its socket, and to hosts that call."""
