"""Phases three and five: can I move like that, and how do I do it? Controllers (Section 3.4) and performing."""
