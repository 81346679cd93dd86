# Everything from a bare checkout, with only make and Python >= 3.11; nothing outside it changes.
# `make test PYTHON=python3.12` uses another Python, in the environment .venv-3.12.

PYTHONS := python3 python3.14 python3.13 python3.12 python3.11
ENVIRONMENT := deploy/environment.py

ifdef PYTHON
VENV := .venv-$(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)
else
PYTHON := $(or $(shell for p in $(PYTHONS); do $$p $(ENVIRONMENT) 2>/dev/null && echo $$p && break; done),python3)
VENV := .venv
endif

DEMO_READY := $(VENV)/.demo-ready
READY := $(VENV)/.ready
RUN := $(VENV)/bin/python
# Most tests wait for processes; with more than two workers for a processor these starve on a slow machine.
WORKERS = $(shell $(RUN) -c 'import os; print(min(2 * os.cpu_count(), 6))')
UV := uv==0.13.8
LOCK := .cache/lock/bin/uv pip compile --quiet --universal --generate-hashes \
	--no-config --no-header --no-annotate

export PIP_CACHE_DIR := $(CURDIR)/.cache/pip
export UV_CACHE_DIR := $(CURDIR)/.cache/uv
export MPLCONFIGDIR := $(CURDIR)/.cache/matplotlib
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# A shell with ROS sourced would add its packages and pytest plugins.
unexport PYTHONPATH PYTHONHOME PIP_USER PIP_TARGET PIP_PREFIX
# Without bytecode each process of the tests would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-rest test-all prove accept check docs machines release lock clean

demo: $(DEMO_READY)
	$(VENV)/bin/quadctl demo

# TESTS has more options of pytest, e.g. `make test TESTS=--complete`.
PYTEST = $(RUN) -m pytest --numprocesses $(WORKERS) --dist worksteal --durations 20 $(TESTS)

test: $(READY)  ## The promises on real processes, and the unit tests: minutes.
	$(PYTEST)

# In the order of the files: neighbours share a system, which takes most of the time here.
test-rest: $(READY)  ## The tests that `make test` leaves out, without the long counts.
	$(PYTEST) -p no:randomly -m "thorough and not prove"

test-all: test test-rest

# A figure that misses its bar ends it at once: the counts after it take more than two hours.
prove: $(READY)  ## The long counts; writes docs/promises.md and docs/figures.md.
	$(RUN) -m benchmarks.measure --write --check
	$(RUN) -m pytest -m "hypothesis and not prove" --hypothesis-profile explore --numprocesses $(WORKERS)
	$(RUN) -m pytest -m "prove and alone" --durations 0
	$(RUN) -m pytest -m "prove and not alone" --durations 0 --numprocesses 3 --dist load --maxschedchunk 1

accept: $(READY)  ## What follows from changed declarations, element by element; WRITE=1 writes it.
	$(RUN) -m tests.golden.accept $(if $(WRITE),--write)

docs: $(READY)  ## The book, in build/book; PUBLISH=REMOTE puts it on the branch gh-pages there, too.
	$(RUN) -m docs.book
	$(if $(PUBLISH),$(VENV)/bin/ghp-import --no-jekyll --no-history --force --push --remote $(PUBLISH) build/book)

check: $(READY)  ## The fast part of the tests: lengths, layers, lint, format, types, clauses.
	$(RUN) tests/checks/house.py

machines:  ## `make demo` and `make test` on three bare machines, or on those of SUITES; as root.
	$(PYTHON) tests/machines.py $(SUITES)

# It publishes nothing. REHEARSE=1 leaves addresses and date open; MACHINES has bare Debians, as root;
# TAGGED=1 is for a workflow that the tag starts.
release: $(READY)  ## Wheel and sdist of the last commit, in dist/: compared, checked, installed.
	$(RUN) -m deploy.release --uv $(UV) $(if $(REHEARSE),--rehearse) $(if $(TAGGED),--tagged) --machines $(MACHINES)

$(DEMO_READY): requirements.lock requirements-build.lock pyproject.toml $(RUN)
	@command -v $(PYTHON) >/dev/null || { echo "There is no $(PYTHON): install Python 3.11 or newer" \
	"(Debian, Ubuntu: apt install python3 python3-venv), or name one: make PYTHON=/path/to/python3.11." >&2; exit 1; }
	@$(PYTHON) $(ENVIRONMENT) $(VENV) user

$(READY): $(DEMO_READY) requirements-dev.lock
	@$(PYTHON) $(ENVIRONMENT) $(VENV) developer

# If this is missing, or links to a Python that is gone, set up again.
$(RUN): ;

lock:  ## Pins the requirements of pyproject.toml; UPGRADE=--upgrade takes the newest versions.
	$(PYTHON) -m venv --clear .cache/lock
	.cache/lock/bin/python -m pip install --quiet $(UV)
	$(LOCK) pyproject.toml --group dev $(UPGRADE) -o requirements-dev.lock
	$(LOCK) pyproject.toml --constraints requirements-dev.lock -o requirements.lock
	$(LOCK) --group build --constraints requirements-dev.lock -o requirements-build.lock

clean:
	rm -rf .venv .venv-* .cache .*_cache .hypothesis build dist *.egg-info demo*.png
	find schemas services cli tests -name __pycache__ -prune -exec rm -rf {} +
