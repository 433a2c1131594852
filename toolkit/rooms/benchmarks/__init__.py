"""Whole experiments: each has the units of its run, the work of a unit, and its own figures."""
