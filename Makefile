# `make help` lists the targets; `make demo` and `make test` need nothing but Python 3.11 or newer.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
OUT ?= mssegment-out
EXTRAS ?= dev

.PHONY: help demo test lint docs pictures benchmarks clean
.DEFAULT_GOAL := help

help: ## list the targets
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

$(BIN)/mssegment: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/.dev: $(BIN)/mssegment
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable '.[$(EXTRAS)]'
	@touch $@

demo: $(BIN)/mssegment ## make the environment, segment the three sample scenes, say where the pictures are
	@for model in translation factorization affine; do \
		echo; echo "== $$model"; \
		$(BIN)/mssegment run configs/$$model.yaml --out $(OUT)/$$model --force --format text || exit; \
	done
	@echo; echo "Pictures and pages:"; ls $(OUT)/*/*.png $(OUT)/*/report.html

test: $(VENV)/.dev ## run all tests
	$(BIN)/python -m pytest

lint: $(VENV)/.dev ## formatting, lint, types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

docs: $(VENV)/.dev ## write the reference of commands and settings anew
	$(BIN)/python -m docs.reference

pictures: $(BIN)/mssegment ## make the pictures of the README anew
	$(BIN)/python -m docs.pictures

benchmarks: $(VENV)/.dev ## the paper's set-ups; see docs/benchmarks.md for the others
	$(BIN)/python -m benchmarks.paper

clean: ## remove the environment and all results
	rm -rf $(VENV) $(OUT)
