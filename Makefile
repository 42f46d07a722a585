# `make help` lists the targets; `make demo` and `make test` need nothing but Python 3.11 or newer.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUT ?= mssegment-out
EXTRAS ?= dev
MINUTES ?= 0.5
# The time of the last commit: the same sources give the same bytes
EPOCH = $(shell git log -1 --format=%ct 2>/dev/null || echo 1577836800)

.PHONY: help demo test oldest lint fuzz docs dist pictures benchmarks clean
.DEFAULT_GOAL := help

help: ## list the targets
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable .
	@touch $@

# one stamp for each choice of extras
$(VENV)/.extra-%: $(VENV)/.installed
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable '.[$*]'
	@touch $@

demo: $(VENV)/.installed ## make the environment, segment the three sample scenes, say where the pictures are
	@for model in translation factorization affine; do \
		echo; echo "== $$model"; \
		$(BIN)/mssegment run configs/$$model.yaml --out $(OUT)/$$model --force --format text || exit; \
	done
	@echo; echo "Pictures and pages:"; ls $(OUT)/*/*.png $(OUT)/*/report.html

# one worker a core, and one BLAS thread a worker
PYTEST = OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n logical --dist worksteal

test: $(VENV)/.extra-$(EXTRAS) ## run all tests, doctests included
	$(PYTEST)

$(VENV)-oldest/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)-oldest
	$(VENV)-oldest/bin/python -m pip install --quiet --upgrade pip
	$(VENV)-oldest/bin/python -m pip install --quiet --editable '.[dev]'
	sed -n '/^dependencies/,/^]/s/.*"\(.*\)>=\(.*\)".*/\1==\2.*/p' pyproject.toml | \
		xargs $(VENV)-oldest/bin/python -m pip install --quiet
	@touch $@

oldest: BIN = $(VENV)-oldest/bin
oldest: $(VENV)-oldest/.installed ## run all tests with the oldest packages that pyproject.toml allows
	$(PYTEST)

lint: $(VENV)/.extra-$(EXTRAS) ## formatting, lint, types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

fuzz: $(VENV)/.extra-$(EXTRAS) ## damage inputs of every kind for half a minute (MINUTES=0.5)
	$(BIN)/python -m benchmarks.fuzz --minutes $(MINUTES)

docs: $(VENV)/.extra-docs ## write the generated references anew, and the site into site/
	$(BIN)/python -m docs.reference
	SOURCE_DATE_EPOCH=$(EPOCH) NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "the site is site/index.html"

dist: $(VENV)/.extra-dist ## build sdist and wheel twice, and check that their bytes are equal
	rm -rf dist
	SOURCE_DATE_EPOCH=$(EPOCH) $(BIN)/python -m build --no-isolation --outdir dist .
	SOURCE_DATE_EPOCH=$(EPOCH) $(BIN)/python -m build --no-isolation --outdir dist/again .
	@for file in dist/*.*; do cmp $$file dist/again/$${file##*/} || exit; done
	@rm -r dist/again; ls -l dist

pictures: $(VENV)/.extra-docs ## make the pictures of the README and of docs/why.md anew
	$(BIN)/python -m docs.pictures
	$(BIN)/python -m docs.pictures_why

benchmarks: $(VENV)/.extra-$(EXTRAS) ## the paper's set-ups; see docs/benchmarks/ for the others
	$(BIN)/python -m benchmarks.paper

clean: ## remove the environment and all results
	rm -rf $(VENV) $(VENV)-oldest $(OUT) dist site
