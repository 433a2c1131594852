"""From a surface to flat pieces: grown and trimmed, or unfolded as a net; and where their edges meet."""
