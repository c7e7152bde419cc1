"""Tests; a package so that mypy knows each module here by one name only."""
