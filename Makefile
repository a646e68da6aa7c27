# make demo: train, evaluate and diagnose into runs/demo; make test: every check. Both first set up .venv where needed.

# The first Python that is recent enough; choose another with `make PYTHON=/path/to/python test`.
PYTHON ?= $(shell for python in python3 python3.14 python3.13 python3.12 python3.11; do \
    $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$python && break; done)

BIN := .venv/bin
DEMO := runs/demo

.DEFAULT_GOAL := help
.PHONY: help demo test lint types tests docs release wheels format clean

help:
	@echo "make demo    train, evaluate and diagnose into $(DEMO)"
	@echo "make test    formatting, lint, types, tests and doctests"
	@echo "make docs    build the site into site/, warnings as errors"
	@echo "make release VERSION=1.2.3  set the version; build and check wheel, sdist and site"
	@echo "make wheels  install wheel and sdist with Python 3.11 to 3.13, and use them"
	@echo "make format  format the code and fix what the linter can"
	@echo "make clean   remove .venv, runs and what tools left behind"

demo: .venv/installed
	@# Finished, it is left alone; interrupted, it goes on; of other code or settings, it is trained anew.
	$(BIN)/python train.py --env homeward/Survey-v0 --steps 3000000 --curve 10 --out $(DEMO)/ppo --resume --replace
	$(BIN)/python evaluate.py --env homeward/Survey-v0 --agents soc50 dmax dmax_mapped dmax_adaptive planner ppo=$(DEMO)/ppo \
	    --episodes 500 --seed 7 --out $(DEMO)/evaluation
	@# Real drives of a Husky: read from HOMEWARD_DATA or downloaded; if that fails (exit code 3), the recording that ships.
	$(BIN)/python diagnose.py --dataset husky_borealtc/FLOORING --robot husky --out $(DEMO)/diagnosis \
	    || { code=$$?; [ $$code -eq 3 ] || exit $$code; \
	         echo "no real recordings to be had: here is the synthetic one that ships" >&2; \
	         $(BIN)/python diagnose.py --robot husky --out $(DEMO)/diagnosis; }

# Side by side, as the tests wait for other processes now and then; all are made even if one fails.
test: .venv/installed
	@$(MAKE) --no-print-directory --jobs --keep-going lint types tests

lint: .venv/installed
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: .venv/installed
	$(BIN)/mypy

tests: .venv/installed
	$(BIN)/python -m pytest --numprocesses 2 --dist worksteal

docs: .venv/installed
	$(BIN)/python -m mkdocs build --strict

release: .venv/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[release]'
	@$(BIN)/python .ci/release.py "$(VERSION)"

wheels:
	.ci/wheels.sh

.DEFAULT:
	@echo "make $@: there is no such target; these are:" >&2; $(MAKE) --no-print-directory help >&2; exit 2

format: .venv/installed
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# Only a change of what is to be installed runs this again; the stamp is written last, so an interrupted one starts over.
.venv/installed: pyproject.toml constraints.txt
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	    echo "homeward needs Python 3.11 or later$(if $(PYTHON), (which '$(PYTHON)' is not)): install one or name it with 'make PYTHON=/path/to/python'" >&2; exit 2; }
	"$(PYTHON)" -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt --editable '.[train,dev]'
	@# pip would compile on one core; files that are no Python of this version are left out, as by pip.
	@$(BIN)/python -W ignore -m compileall -qq -j 0 .venv/lib || true
	@touch $@

clean:
	rm -rf .venv runs site build dist *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find homeward envs agents tests benchmarks -name __pycache__ -prune -exec rm -rf {} +
