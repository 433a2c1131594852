"""Models of the package: its objects, random everyday things, worlds and all that stands there."""
