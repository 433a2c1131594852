"""What happens to a patch between file and photograph, as Expectation-over-Transformation parts, one per file."""
