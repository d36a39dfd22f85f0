"""Checks of a bench, each with its mend; nothing moves."""
