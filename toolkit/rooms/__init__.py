"""What stands beside the core: each room adds its own commands and kinds to the road, and the core runs without it."""
