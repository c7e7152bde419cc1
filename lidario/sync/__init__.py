"""The session without ``await``, in a thread of its own."""
