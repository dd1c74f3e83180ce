"""What the controller tells by its console and over HTTP."""
