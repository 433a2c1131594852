"""Boosters on objects that are photographed: a file for each kind, and the table of kinds."""
