"""What fibres do to the photons that pass them: one small class for each kind of noise."""
