"""Parts that several programs of ours have alike: what is called, measured, loaded, or sought."""
