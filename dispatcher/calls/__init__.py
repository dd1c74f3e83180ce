"""Who may ask what of the dispatcher, and how each request is answered."""
