"""Phase two: what do I see? Teacher models from stereo images (Section 3.3)."""
