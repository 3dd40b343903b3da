# make plan   the main job: plan problems/tilt_insert.yaml into results/tilt_insert/
# make test   the tests;  make lint  ruff and mypy;  make clean  removes the environment
# make api    docs/api.md and docs/reference.md, from the docstrings of the public names and the schema of the files
# make docs   the documentation as a site into docs/_build/html, the gallery planned anew
# make wheel  a wheel and a source distribution into dist/
# make bench  this planner beside others, about ten minutes, into results/benchmarks.md; make bench BENCH=--quick
# make campaign  random hostile cases for an hour, into results/campaign.md; make campaign CAMPAIGN="--minutes 10"
#                or CAMPAIGN=--full: as many cases as were asked for
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin

.PHONY: plan test lint api docs wheel bench campaign clean
.DELETE_ON_ERROR:

plan: $(VENV)/.main
	$(BIN)/ssm-planner plan problems/tilt_insert.yaml

test: $(VENV)/.test
	$(BIN)/python -m pytest -n auto

lint: $(VENV)/.lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

api: $(VENV)/.main
	$(BIN)/python docs/make_api.py
	$(BIN)/python docs/make_reference.py

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -q -W --keep-going docs docs/_build/html

wheel: $(VENV)/.lint
	rm -rf dist
	$(BIN)/python -m build --outdir dist .

campaign: $(VENV)/.test
	$(BIN)/python -m tests.campaign $(CAMPAIGN)

bench: $(VENV)/.bench
	$(BIN)/python tests/benchmarks/bench.py $(BENCH)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo "ssm_planner needs Python 3.10 or newer; set PYTHON=/path/to/python3"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.main: pyproject.toml constraints.txt $(wildcard ssm_planner/native/*.[ch]) | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.test: $(VENV)/.main
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

$(VENV)/.lint: $(VENV)/.main
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[lint]'
	@touch $@

$(VENV)/.docs: $(VENV)/.main
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	@touch $@

$(VENV)/.bench: $(VENV)/.main
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'
	@touch $@

clean:
	rm -rf $(VENV)
