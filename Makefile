# Everything sets itself up in .venv; only Python 3.11 or later (with venv and pip) and make are needed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
SCANS ?= 3

.PHONY: demo test check bench clean
.DEFAULT_GOAL := demo

$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $(READY)

demo: $(READY)  ## live scans of a simulated lidar, as bytes through a real pseudo-terminal
	$(BIN)/lidario info sim://rplidar-s2
	$(BIN)/lidario scan sim://rplidar-s2 -n $(SCANS)

test: $(READY)  ## the tests
	$(BIN)/python -m pytest

check: $(READY)  ## lint, format, types, and the tests under coverage
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

bench: $(READY)  ## the benchmarks, beside their rivals; see benchmarks/README.md
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) .coverage* .mypy_cache .pytest_cache .ruff_cache .hypothesis benchmarks/.peers
