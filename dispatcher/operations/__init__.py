"""Operations on the physical layer, one class for each kind of request."""
