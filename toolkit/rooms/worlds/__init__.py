"""Places outdoors: a city, a field, an airfield, a harbour, or the user's own; what stands there and where."""
