"""The verdict as text, pages and robot files."""
