"""Phase four: is that one like me? The verdict (Sections 3.4 and 4)."""
