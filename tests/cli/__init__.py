"""The command, in this process where that is fair and as a process of its own where it is not."""
