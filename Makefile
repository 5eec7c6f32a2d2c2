# The two commands: `make run` and `make test`. Each sets up everything first; `make help` lists the rest.
PY := .venv/bin/python
SOURCES := executive skills tests benchmarks examples
BENCHMARKS := $(notdir $(basename $(wildcard benchmarks/[a-z]*.py))) $(patsubst benchmarks/%/__main__.py,%,$(wildcard benchmarks/*/__main__.py))

.PHONY: help setup run quick test test-slow docs pages site bench example pictures gallery lint format-check types arrows unit format clean

help:
	@echo "make run        set up, then sort the groceries with a dropped item on the way"
	@echo "make test       set up, then every check of the code: lint, format-check, types, arrows, unit"
	@echo "make quick      set up, then the pure tests alone: under a minute"
	@echo "make test-slow  set up, then the tests that take minutes"
	@echo "make docs       set up, then do what README and docs say, and build them in build/docs; a broken link is an error"
	@echo "make bench      set up, then every benchmark, printed (long; make bench BENCHMARKS=monitor for one)"
	@echo "make example    set up, then make the run in runs/example anew"
	@echo "make pictures   set up, then draw the pictures in docs/images anew"
	@echo "make gallery    make the films and recordings in docs/gallery anew (ten minutes)"
	@echo "make setup      the set-up alone; PYTHON=... names the interpreter"
	@echo "make format     rewrite the sources as format-check wants them"
	@echo "make clean      remove .venv and everything that tools leave behind (runs/ stays)"

setup:
	@scripts/setup

run: setup
	.venv/bin/executive run domains/grocery --seed 3 --fault drop@4

# Every check runs, even after one has failed; the exit code is that of all of them together.
test: setup
	@$(MAKE) --no-print-directory --keep-going lint format-check types arrows unit

lint:
	$(PY) -m ruff check $(SOURCES)

format-check:
	$(PY) -m ruff format --check $(SOURCES)

types:
	$(PY) -m mypy

arrows:
	.venv/bin/lint-imports --no-logo

# Each process gets tests that lie beside each other, and what modules share is made once; who is done first takes over.
unit:
	PICTURES=build/pictures $(PY) -m pytest -q -n auto --maxprocesses 4 --dist worksteal

quick: setup
	$(PY) -m pytest -q -m quick -n 2 --dist worksteal

test-slow: setup
	$(PY) -m pytest -q -m slow

docs: setup
	@$(MAKE) --no-print-directory --keep-going pages site

# Every command that a page shows is carried out.
pages:
	$(PY) -m pytest -q -m pages -n auto --maxprocesses 4 --dist worksteal

# What builds the site is installed when it is first needed. --strict: what is warned of is an error.
site:
	@$(PY) -c 'import mkdocs, material, mkdocstrings_handlers.python' 2>/dev/null \
		|| $(PY) -m pip install -qq --no-input --disable-pip-version-check -c constraints.txt -e '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --quiet --strict
	@echo "build/docs/index.html; with search: $(PY) -m http.server --bind 127.0.0.1 --directory build/docs"

bench: setup
	@for file in $(BENCHMARKS); do echo "== $$file"; $(PY) -m benchmarks.$$file || exit 1; done

example: setup
	$(PY) scripts/example

# A run with a drop and a recovery in the viewer, as README shows it.
pictures: setup
	$(PY) scripts/pictures

# Of each domain a run in which something goes wrong, as docs/gallery shows it.
gallery: setup
	$(PY) -m benchmarks.gallery.make

format: setup
	$(PY) -m ruff check --fix $(SOURCES)
	$(PY) -m ruff format $(SOURCES)

clean:
	rm -rf .venv build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find $(SOURCES) -name __pycache__ -type d -prune -exec rm -rf {} +
