"""What a peer that means harm can do to a program: the lateness of its event loop, and its memory."""
