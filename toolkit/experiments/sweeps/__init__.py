"""How far a patch carries: one thing varied, the rest kept."""
