"""Places outdoors: what stands there, the sky above it, and the weather between it and the camera."""
