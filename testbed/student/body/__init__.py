"""Phase one: what body have I? Self-models, how they are found (Section 3.2), and what breaks them."""
