"""Events of a run, as the dispatcher tells them or its files keep them."""
