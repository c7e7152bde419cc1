"""Tests of `lidario.testing`."""
