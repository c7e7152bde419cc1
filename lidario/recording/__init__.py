"""Recordings: every byte in both directions in a file, and reading and playing such files."""
