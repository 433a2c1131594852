"""A benchmark of boosters that others can enter: an entry is a booster and its record; the pictures are ours."""
