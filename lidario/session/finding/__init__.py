"""From a source to a device that has said what it is; also after its line was lost."""
