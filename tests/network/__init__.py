"""Lidars of other machines: what travels over zenoh, and a port that receives it."""
