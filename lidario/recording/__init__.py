"""What was received, kept and decoded again."""
