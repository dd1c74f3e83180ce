"""One emulated network from start to end: nodes and links made, waited for, watched, removed."""
