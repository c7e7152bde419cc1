"""Scans and sectors as a user gets them, and what is made of them: points, messages, one cloud of several."""
