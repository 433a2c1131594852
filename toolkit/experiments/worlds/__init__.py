"""Objects in a world, seen by a network from a grid of cameras through weather: the paper's experiment in a city."""
