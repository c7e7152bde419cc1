"""Requests, responses and the stop requests of one device."""
