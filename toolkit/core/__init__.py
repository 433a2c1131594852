"""Tools without knowledge of the field: errors, files, seeded draws, console, statistics, the workspace."""
