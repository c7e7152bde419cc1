"""The command ``lidario``: thin verbs over the public API.

One module a verb (`devices`, `info`, `scan`, `record`, `play`, `export`, `sim`), each of which imports what is
heavy only when it runs; and what they share: `errors` maps every exception to a text and an exit code, `running`
ends an event loop on a signal, `streams` writes to stdout and stderr, `output` shows what goes on, `picture` and
`formats` convert a scan to text, `parameters` reads what is typed. This is the only package that imports click and
rich.
"""
