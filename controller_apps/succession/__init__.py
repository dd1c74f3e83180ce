"""What a controller leaves to the one that is started after it."""
