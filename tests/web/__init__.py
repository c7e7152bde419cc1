"""The live page: its parts, its server, and the page itself in a browser."""
