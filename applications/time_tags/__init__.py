"""Time tags: clicks of detectors as instruments write them."""
