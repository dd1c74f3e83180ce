"""Hardware layer: the quantum network interface card (QNIC) and what it reports back."""
