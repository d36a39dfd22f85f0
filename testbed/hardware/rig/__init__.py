"""Two cameras: frames, pairs of them, rectification, and what stands before the backdrop."""
