"""How fast lidario is beside its rivals; ``make bench`` runs it, `benchmarks/README.md` says what came out."""
