"""The command ``lidario``: thin verbs over the public API.

Each verb is a module of the same name, and imports what is heavy only when it runs; `main` lists all of them. What
they share: `errors` maps every exception to a text and an exit code, `running` ends an event loop on a signal
and shows what is logged, `streams` writes to stdout and stderr, `output` shows what goes on, `parameters` reads
what is typed, `machine` reads what the system says of itself. `picture`, `chart` and `formats` convert a scan to
text. This is the only package that imports click and rich.
"""
