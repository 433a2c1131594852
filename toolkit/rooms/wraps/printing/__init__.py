"""Pages with the pieces of a wrap, outlines for a machine, and the object from six sides."""
