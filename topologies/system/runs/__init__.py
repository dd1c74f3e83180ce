"""One run: its shared state, and the start of its programs."""
