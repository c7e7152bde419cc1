# Everything sets itself up in .venv; only Python 3.11 or later (with venv and pip) and make are needed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUNS := $(VENV)/.runs
TESTED := $(VENV)/.tested
READY := $(VENV)/.ready
# pyright asks the first `python` in PATH where the packages are. It has --pythonpath too, but --verifytypes ignores that.
PYRIGHT := PATH="$(BIN):$$PATH" $(BIN)/pyright
SCANS ?= 3
# Quick tests wait for hardly anything, and each worker takes 8 s to find them. Long ones wait for a process or a clock
# at times, so two share a core.
CORES := $(shell getconf _NPROCESSORS_ONLN)
WORKERS ?= $(shell expr 1 + $(CORES))
CHECK_WORKERS ?= $(shell expr 2 \* $(CORES))
TESTS ?=
# Without compiled files, each program that the tests start compiles everything again: 0.8 s each time.
unexport PYTHONDONTWRITEBYTECODE
SEED ?= 7
HOURS ?= 24
FUZZ_S ?= 600

.PHONY: demo test check lint covered docs bench faults soak fuzz floods package arm64 s390x release clean
.DEFAULT_GOAL := demo

# What the command needs is a fifth of what the tests need, and the checks need half as much again. Each set holds the
# one before, so that a new environment is made in one go.
define set_up
	@echo "Setting up $(VENV) for $(1), the first time only."
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable $(2)
endef

$(RUNS): pyproject.toml
	$(call set_up,the command: half a minute,'.[cli]')
	@touch $(RUNS)

$(TESTED): pyproject.toml
	$(call set_up,the tests: a minute,'.[test]')
	@touch $(RUNS) $(TESTED)

$(READY): pyproject.toml
	$(call set_up,the checks: a minute and a half,'.[dev]')
	@touch $(RUNS) $(TESTED) $(READY)

demo: $(RUNS)  ## live scans of a simulated lidar, as bytes through a real pseudo-terminal
	$(BIN)/lidario info sim://rplidar-s2
	$(BIN)/lidario scan sim://rplidar-s2 -n $(SCANS)

test: $(TESTED)  ## the quick tests; CI runs the long ones, too
	$(BIN)/python -m pytest -n $(WORKERS)

check: $(READY)  ## lint, types and workflows, beside the quick tests under coverage; TESTS=--long: all tests, as CI runs them
	+$(MAKE) --no-print-directory -j2 lint covered

lint: $(READY)  ## lint, format, types, workflows
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy examples
	$(PYRIGHT)
	$(PYRIGHT) --verifytypes lidario --ignoreexternal
	$(BIN)/zizmor --offline --quiet --pedantic .

covered: $(READY)
	$(BIN)/python -m pytest -n $(CHECK_WORKERS) $(TESTS) --cov --cov-report=term-missing:skip-covered

docs: $(READY)  ## the documentation, in .site/; any warning is an error
	$(BIN)/zensical build --strict --clean

bench: $(TESTED)  ## the benchmarks, beside other drivers; see benchmarks/README.md
	$(BIN)/python -m benchmarks

faults: $(TESTED)  ## what every fault costs, on fourteen devices, and what other drivers make of it; five minutes
	$(BIN)/python -m benchmarks --only faults

soak: $(TESTED)  ## a day of faults and users in driven time; half an hour
	$(BIN)/python -m benchmarks.soak --seed $(SEED) --hours $(HOURS)

fuzz: $(TESTED)  ## ten minutes of any bytes for each target; see SECURITY.md
	$(BIN)/python -m tests.fuzz -max_total_time=$(FUZZ_S)

floods: $(TESTED)  ## peers that send as fast as they can, from every source; four minutes
	$(BIN)/python -m benchmarks.floods

package:  ## the wheel and the sdist in dist/, each tried in an empty environment; half a minute
	PYTHON="$(PYTHON)" .ci/package

arm64 s390x: $(TESTED)  ## decoding as on a Raspberry Pi, and on a big-endian machine, under qemu; see CONTRIBUTING.md
	.ci/emulate $@

release:  ## `make release VERSION=1.2.3`: the version, the date in CHANGELOG.md, one commit, one tag; pushes nothing
	.ci/release "$(VERSION)"

clean:
	rm -rf build dist .emulated $(VENV) .fuzz .coverage* .mypy_cache .site .pytest_cache .ruff_cache .hypothesis benchmarks/.peers
