# make plan   the main job: plan problems/tilt_insert.yaml into results/tilt_insert/
# make test   the laws, for every change: minutes on two cores;  make test-all  every test, several times as long
# make lint   ruff and mypy;  make clean  removes the environment
# make api    docs/api.md and docs/reference.md, from the docstrings of the public names and the schema of the files
# make docs   the documentation as a site into docs/_build/html, the gallery planned anew
# make picture  docs/film.gif, and the figures and pictures of the documents, from results/; needs Chromium
# make wheel  a wheel and a source distribution into dist/;  make wheels  those of every system, compiled by zig
# make bench  this planner beside others, about ten minutes, into results/benchmarks.md; make bench BENCH=--quick
# make campaign  random hostile cases for an hour, into results/campaign.md; make campaign CAMPAIGN="--minutes 10"
#                or CAMPAIGN=--full: as many cases as were asked for
# make mutants   change one operation of the package at a time: do the tests notice? into results/mutants.md;
#                make mutants MUTANTS="--count 300 --seed 1 --rooms verification,retiming"
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
# Without --no-compile, pip compiles thousands of modules that nobody imports.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt
SOURCES := pyproject.toml constraints.txt $(wildcard ssm_planner/native/*.[ch]) ssm_planner/native/CMakeLists.txt
# An installation that adds packages to an environment need not compile the C part again.
ADD     := $(INSTALL) --config-settings=wheel.cmake=false

# Without cached bytecode, every process compiles the package and its tests anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: plan test test-all lint api docs picture wheel wheels bench campaign mutants clean
.DELETE_ON_ERROR:

plan: $(VENV)/.main
	$(BIN)/ssm-planner plan problems/tilt_insert.yaml

test: $(VENV)/.test
	$(BIN)/python -m pytest -n auto

test-all: $(VENV)/.test
	$(BIN)/python -m pytest -n auto -m "" --durations 10

lint: $(VENV)/.lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

api: $(VENV)/.main
	$(BIN)/python docs/make_api.py
	$(BIN)/python docs/make_reference.py

docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -q -W --keep-going docs docs/_build/html

picture: $(VENV)/.main
	$(BIN)/ssm-planner film results/eye_approach --speed 50% -o docs/film.gif
	$(BIN)/python docs/make_pictures.py
	$(BIN)/python docs/make_figures.py

wheel: $(VENV)/.lint
	rm -rf dist
	$(BIN)/python -m build --outdir dist .

wheels: $(VENV)/.publish
	.ci/wheels

campaign: $(VENV)/.test
	$(BIN)/python -m tests.campaign $(CAMPAIGN)

mutants: $(VENV)/.test
	$(BIN)/python -m tests.mutation $(MUTANTS)

bench: $(VENV)/.bench
	$(BIN)/python -m tests.benchmarks.bench $(BENCH)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	  || { echo "ssm_planner needs Python 3.10 or newer; set PYTHON=/path/to/python3"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.main: $(SOURCES) | $(BIN)/python
	$(INSTALL) -e .
	@touch $@

# One installation brings both: a fresh clone needs no second one for its tests.
$(VENV)/.test: $(SOURCES) | $(BIN)/python
	$(INSTALL) -e '.[test]'
	@touch $(VENV)/.main $@

$(VENV)/.lint: $(VENV)/.main
	$(ADD) -e '.[lint]'
	@touch $@

$(VENV)/.docs: $(VENV)/.main
	$(ADD) -e '.[docs]'
	@touch $@

# One run of pip for all of them.
$(VENV)/.ci: $(SOURCES) | $(BIN)/python
	$(INSTALL) -e '.[test,lint,docs]'
	@touch $(VENV)/.main $(VENV)/.test $(VENV)/.lint $(VENV)/.docs $@

# Packages for the tests that `.ci/run` repeats with other versions of Python.
$(VENV)/.versions: $(SOURCES) | $(BIN)/python
	$(ADD) -e . pytest pytest-xdist hypothesis pint
	@touch $(VENV)/.main $@

$(VENV)/.bench: $(VENV)/.main
	$(ADD) -e '.[bench]'
	@touch $@

$(VENV)/.publish: $(VENV)/.main
	$(ADD) -e '.[publish]'
	@touch $@

clean:
	rm -rf $(VENV)
