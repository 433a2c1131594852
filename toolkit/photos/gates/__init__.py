"""Whether a photograph is fit to be compared: measured numbers, thresholds with their reasons, and advice."""
