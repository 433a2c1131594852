"""What patches are compared with: codes, photographs and fixed patterns in their place (seed, section D.2)."""
