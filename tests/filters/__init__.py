"""Tests of `lidario.filters`."""
