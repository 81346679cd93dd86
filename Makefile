# Everything from a bare checkout, with only make and Python >= 3.11; nothing outside it changes.
# `make test PYTHON=python3.12` uses another Python, in the environment .venv-3.12.

FITS = -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))'
PYTHONS := python3 python3.14 python3.13 python3.12 python3.11

ifdef PYTHON
VENV := .venv-$(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
else
PYTHON := $(shell for p in $(PYTHONS); do $$p $(FITS) 2>/dev/null && echo $$p && break; done)
VENV := .venv
endif

READY := $(VENV)/.ready
RUN := $(VENV)/bin/python
# Most tests wait for processes; with more than two workers for a processor these starve on a slow machine.
WORKERS = $(shell $(RUN) -c 'import os; print(min(2 * os.cpu_count(), 6))')
LOCK := .cache/lock/bin/uv pip compile pyproject.toml --quiet --universal --generate-hashes \
	--no-config --no-header --no-annotate

export PIP_CACHE_DIR := $(CURDIR)/.cache/pip
export UV_CACHE_DIR := $(CURDIR)/.cache/uv
export MPLCONFIGDIR := $(CURDIR)/.cache/matplotlib
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# A shell with ROS sourced would add its packages and pytest plugins.
unexport PYTHONPATH PYTHONHOME PIP_USER PIP_TARGET PIP_PREFIX

.PHONY: demo test prove check docs lock clean

demo: $(READY)
	$(VENV)/bin/quadctl demo

test: $(READY)
	$(RUN) -m pytest --numprocesses $(WORKERS) --dist worksteal --durations 20

# A figure that misses its bar ends it at once: the counts after it take more than two hours.
prove: $(READY)  ## The long counts; writes docs/promises.md and docs/figures.md.
	$(RUN) -m benchmarks.measure --write --check
	$(RUN) -m pytest -m "prove and alone" --durations 0
	$(RUN) -m pytest -m "prove and not alone" --durations 0 --numprocesses 3 --dist load --maxschedchunk 1

docs: $(READY)  ## The book, in build/book.
	$(RUN) -m docs.book

check: $(READY)  ## The fast part of the tests: lengths, layers, lint, format, types, clauses.
	$(RUN) tests/checks/house.py

$(READY): requirements-dev.lock pyproject.toml $(RUN)
	@$(or $(PYTHON),false) $(FITS) 2>/dev/null || { \
	echo "quadctl needs Python 3.11 or newer with venv and ensurepip; tried $(or $(PYTHON),$(PYTHONS))."; \
	echo "Install one (Debian, Ubuntu: apt install python3 python3-venv; macOS: brew install python)"; \
	echo "or name one: make $(MAKECMDGOALS) PYTHON=/path/to/python3.12"; exit 1; } >&2
	@echo "Setting up $(VENV), once: a minute or so."
	$(PYTHON) -m venv --clear $(VENV)
	$(RUN) -m pip install --quiet --require-hashes -r requirements-dev.lock
	$(RUN) -m pip install --quiet --no-deps --no-build-isolation -e .
	@touch $@

# If this is missing, or links to a Python that is gone, set up again.
$(RUN): ;

lock:  ## Pins the requirements of pyproject.toml; UPGRADE=--upgrade takes the newest versions.
	$(PYTHON) -m venv --clear .cache/lock
	.cache/lock/bin/python -m pip install --quiet uv==0.13.8
	$(LOCK) --group dev $(UPGRADE) -o requirements-dev.lock
	$(LOCK) --constraints requirements-dev.lock -o requirements.lock

clean:
	rm -rf .venv .venv-* .cache .*_cache .hypothesis build dist *.egg-info demo.png
	find schemas services cli tests -name __pycache__ -prune -exec rm -rf {} +
