"""What the package builds: the objects that come with it, random everyday things, worlds and all that stands there."""
