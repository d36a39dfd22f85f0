# run, test, lint, bench, clean. Everything that a target needs is made in .venv first.

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
TOOLS := $(VENV)/.tools
PEERS := $(VENV)/.peers
SCENARIO ?= scenarios/whom_to_imitate.yaml

.PHONY: run leaderboard test lint bench docs firmware clean help
.DEFAULT_GOAL := help

help:
	@echo "make run    run $(SCENARIO) (or SCENARIO=file)"
	@echo "make test   the fast tests"
	@echo "make leaderboard   all students and baselines on the same teachers"
	@echo "make lint   style and types"
	@echo "make bench  the benchmarks, into benchmarks/results.json and docs/benchmarks.md (or ONLY=group)"
	@echo "make docs   the reference of the Python package, as web pages in build/docs"
	@echo "make firmware   the robots' firmware, into hardware/firmware/build (needs gcc-avr)"
	@echo "make clean  remove caches and the environment; runs/ stays"

run: $(STAMP)
	$(BIN)/testbed run $(SCENARIO)

leaderboard: $(STAMP)
	$(BIN)/testbed run leaderboard

# Tests that need an AVR compiler and simavr are left out where these are missing; the summary names them and the packages.
test: $(TOOLS)
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -q -m "not slow"

# pre-commit needs a git checkout; in an unpacked archive its three commands do the same.
lint: $(TOOLS)
	@if git rev-parse --is-inside-work-tree >/dev/null 2>&1; then \
		$(BIN)/pre-commit run --all-files; \
	else \
		$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy; \
	fi

# ONLY=seeing measures some groups, FULL=1 as a whole what is otherwise scaled from a part.
bench: $(PEERS)
	$(BIN)/python -m benchmarks $(ONLY) $(if $(FULL),--full)

# The stamp is newer than what it was made from, or the environment is made again on top of what is there.
$(STAMP): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null 2>&1 && $(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null || { \
		found=$$(python3 -c 'import platform; print(platform.python_version())' 2>/dev/null || echo none); \
		echo "Python 3.11 is needed ($(PYTHON) is missing or another version; python3 here: $$found)."; \
		echo "PyBullet has no wheels for newer Pythons. Install it, e.g. apt-get install python3.11 python3.11-venv,"; \
		echo "or name it: make PYTHON=/path/to/python3.11"; \
		exit 1; } >&2
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || { \
		rm -rf $(VENV); echo "The venv module is missing: apt-get install python3.11-venv" >&2; exit 1; }
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e .
	@touch $@

# What only developers and the tests need; PyTorch, for the learning clients, is the largest of it.
$(TOOLS): $(STAMP)
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

# What people import; everything else is a step away by its links.
docs: $(STAMP)
	@$(BIN)/python -c 'import pdoc' 2>/dev/null || \
		$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[docs]'
	$(BIN)/python -W ignore -m pdoc --docformat google -o build/docs testbed
	@echo "build/docs/index.html"

# What the benchmarks compare with. Without it they still run, and leave those rows out.
$(PEERS): $(STAMP)
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[bench]' && touch $@ || \
		echo "Some peers could not be installed; their rows will be left out." >&2

firmware:
	$(MAKE) -C hardware/firmware

clean:
	rm -rf hardware/firmware/build hardware/emulator/build
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
