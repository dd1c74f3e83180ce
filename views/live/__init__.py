"""The live view: what happens in a network, or happened in a run, as a page of the browser."""
