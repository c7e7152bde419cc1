"""Fuzzing: any bytes at every door that a stranger can reach; ``make fuzz``, or ``python -m tests.fuzz --help``.

A *target* takes bytes and does with them what a device, a peer or a text could. It raises an AssertionError when
what is promised does not hold; any other exception that gets out is a finding too. What is promised stands at its
head.
`tests.fuzz.targets.TARGETS` has all of them: a new one is a function there, and seeds for it.

Nothing is imported here: what is to be searched is imported under the eyes of the engine.
"""
