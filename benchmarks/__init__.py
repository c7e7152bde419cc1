"""How fast lidario is beside other drivers; ``make bench`` runs it, `benchmarks/README.md` says what came out."""
