"""Where a photograph was taken: the lens, the board, the pose, and which pose of the plan it is."""
