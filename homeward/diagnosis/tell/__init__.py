"""The verdict in words, pages and robot files."""
