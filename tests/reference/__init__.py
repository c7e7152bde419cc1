"""Slow scalar decoders written from the protocol descriptions, to judge the production code by.

Nothing in this package imports the code under test. The decoders (`rplidar`, `ydlidar`) handle one sample
at a time in plain Python and are meant to be compared with the protocol by eye; `damage` spoils byte streams
in a repeatable way; `golden` loads the vendor-decoded streams from ``tests/data``.
"""
