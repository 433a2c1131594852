"""The procedural objects: the four that come with the kit, and random everyday ones to train a classifier on."""
