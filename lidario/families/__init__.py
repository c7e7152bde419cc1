"""What is particular to each vendor: one folder each, with the interface that `base` describes."""
