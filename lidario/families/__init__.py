"""The vendors' dialects, one folder each, behind the one face that `base` describes."""
