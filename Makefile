# `make demo` and `make test` do all their own set-up in .venv; they need Python ≥ 3.11 and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --disable-pip-version-check --no-input
WITH_GROUPS := pip>=25.1
TESTED := .[physics,robots,ros2,coppeliasim]
# Each worker begins with a run of files of its own: few of them wait for the same kernel. A worker more than cores
# waits less, but collects and compiles besides: it takes longer.
CORES := $(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
WORKERS := -n $(CORES) --maxprocesses 4 --dist worksteal
LOCKED := $(if $(CI),-c ci.lock)

# Without bytecode kept beside them, each process that a test starts would compile all modules anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all test-oldest test-newest lint style types pytest pytest-all docs gallery chromium lerobot format bench lock release-check mutants clean
.DEFAULT_GOAL := help

help:
	@echo "make demo      drive a Panda along a drawing: two laws, servos and physics; results in results/demo"
	@echo "make test      check style, run the tests"
	@echo "make test-all  also the long tests and the types"
	@echo "make types     check the types"
	@echo "make lerobot   install LeRobot (5 GB) beside, so that make test-all tests with it"
	@echo "make test-oldest, make test-newest   the tests with the oldest and the newest dependencies"
	@echo "make lock      write anew which versions CI installs (ci.lock)"
	@echo "make mutants FOLDER=supervisor   change the code of a package in a thousand places: do its tests see it?"
	@echo "make release-check   build wheel and sdist, install the wheel elsewhere and run it, check types and layout"
	@echo "make docs      build the documentation as a site: results/docs/index.html"
	@echo "make bench     compare speed with Pinocchio, MuJoCo, DQ Robotics, Pink, Mink and C, physics with real time"
	@echo "make clean     remove the environment and the results of the demo"

$(VENV)/created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "dqcontrol needs Python 3.11 or newer: make PYTHON=/path/to/python3.11 …" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null \
	  || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && apt-get update -qq && apt-get install -y -qq python3-venv; } \
	  || { echo "install Python's venv module first: apt-get install python3-venv" >&2; exit 1; }
	@echo "creating the environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/demo: $(VENV)/created pyproject.toml
	@echo "installing dqcontrol with MuJoCo, example robots, readers of data and drawings, browser view and clips (about 500 MB to download)"
	@$(PIP) -e '.[physics,robots,data,view,video,paint]'
	@touch $@

$(VENV)/test: $(VENV)/created pyproject.toml
	@echo "installing dqcontrol with everything that its tests compare it with"
	@$(PIP) -q '$(WITH_GROUPS)'
	@$(PIP) $(LOCKED) -e '$(TESTED)' --group dev
	@touch $@

# LeRobot's own library, for the slow tests that meet it; it needs Python 3.12 and pulls a CUDA build of PyTorch.
LEROBOT := $(VENV)-lerobot
LEROBOT_PYTHON ?= python3.12

$(LEROBOT)/lerobot: pyproject.toml
	@$(LEROBOT_PYTHON) -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 12))' 2>/dev/null \
	  || { echo "LeRobot needs Python 3.12 or newer: make LEROBOT_PYTHON=/path/to/python3.12 lerobot" >&2; exit 1; }
	@$(LEROBOT_PYTHON) -m venv $(LEROBOT)
	@echo "installing LeRobot in $(LEROBOT) (about 5 GB)"
	@$(LEROBOT)/bin/python -m pip install --disable-pip-version-check --no-input 'lerobot[dataset,kinematics]==0.6.1' -e '.[physics]' -e lerobot_plug
	@touch $@

lerobot: $(LEROBOT)/lerobot

chromium:
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null \
	  || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && echo "installing Chromium for the tests of the browser view (about 414 MB)" \
	    && apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium >/dev/null; } \
	  || echo "the tests of the browser view are left out; for them: apt-get install chromium" >&2

LOOK := --size 1280x960 --azimuth=-65deg --elevation=-10deg

demo: $(VENV)/demo
	@$(BIN)/dqcontrol run examples/demo.yaml --out results/demo --force
	@$(BIN)/dqcontrol clip results/demo/K+FF-physics results/demo.png --force $(LOOK) || true  # needs OpenGL
	@echo now take the target in your own hand: $(BIN)/dqcontrol play

lint: style types

style: $(VENV)/test
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/lint-imports

# Continuous integration checks types besides: they take as much processor time as an eighth of the tests. Those of
# tests, examples and benchmarks, which take longer than those of src, are checked by `make release-check`.
types: $(VENV)/test
	@$(BIN)/mypy
	@$(BIN)/pyright src tests/test_typed_program.py

pytest: $(VENV)/test
	@$(BIN)/pytest $(WORKERS)

pytest-all: $(VENV)/test
	@$(BIN)/pytest $(WORKERS) -m ''

test: chromium style pytest

test-all: chromium lint pytest-all

docs: $(VENV)/test
	@$(BIN)/sphinx-build -W --keep-going -q docs results/docs
	@echo "results/docs/index.html"

gallery: $(VENV)/test
	@for program in $(wildcard examples/[0-9]*.py); do \
	  (cd docs/pictures/examples && "$(CURDIR)/$(BIN)/python" "$(CURDIR)/$$program") || exit 1; done
	@$(BIN)/python tools/update_tiles.py

# What releases are made with, away from the environment that they are checked in.
RELEASE := $(VENV)-release
UV := $(RELEASE)/bin/uv

$(RELEASE)/tools: pyproject.toml
	@$(PYTHON) -m venv $(RELEASE)
	@$(RELEASE)/bin/python -m pip install --disable-pip-version-check --no-input -q '$(WITH_GROUPS)'
	@$(RELEASE)/bin/python -m pip install --disable-pip-version-check --no-input -q --group release
	@touch $@

lock: $(RELEASE)/tools
	@$(UV) pip compile -q pyproject.toml --upgrade --universal --python-version 3.11 --extra physics --extra robots \
	  --extra ros2 --extra coppeliasim --group dev --no-annotate --no-emit-index-url --no-emit-find-links \
	  --custom-compile-command 'make lock' -o ci.lock

# The least releases that pyproject.toml allows, and the newest with Numba's upper bound lifted. The tests of ROS 2 and
# of the site are left out because their packages are missing; all others run.
test-oldest: $(RELEASE)/tools
	@$(UV) venv -q --clear --python $(PYTHON) $(VENV)-oldest
	@VIRTUAL_ENV=$(CURDIR)/$(VENV)-oldest $(UV) pip install -q --resolution lowest-direct -e '.[physics,robots]' --group test
	@$(VENV)-oldest/bin/python -m pytest $(WORKERS)

test-newest: $(RELEASE)/tools
	@$(UV) venv -q --clear --python $(PYTHON) $(VENV)-newest
	@echo numba >$(VENV)-newest/overrides.txt
	@VIRTUAL_ENV=$(CURDIR)/$(VENV)-newest $(UV) pip install -q --upgrade --override $(VENV)-newest/overrides.txt \
	  -e '.[physics,robots]' --group test
	@$(VENV)-newest/bin/python -m pytest $(WORKERS)

release-check: $(VENV)/test $(RELEASE)/tools
	@rm -rf dist
	@$(RELEASE)/bin/python -m build -q
	@$(RELEASE)/bin/twine check --strict dist/*
	@$(RELEASE)/bin/repo-review .
	@$(RELEASE)/bin/zizmor --offline --quiet .github
	@$(BIN)/pyright --threads 2 --project pyproject.toml
	@$(BIN)/python tools/check_release.py dist

# A package's code with a thousand slips, one at a time, against its own tests (CONTRIBUTING.md).
FOLDER := supervisor
SLIPS := results/mutants/$(FOLDER)

mutants: $(VENV)/test $(RELEASE)/tools
	@[ -n '$(FOLDER)' ] && [ -d 'tests/$(FOLDER)' ] && [ -d 'src/dqcontrol/$(FOLDER)' ] \
	  || { echo "FOLDER: expected a package with tests of its own, as supervisor or laws, got '$(FOLDER)'" >&2; exit 2; }
	@mkdir -p $(SLIPS)
	@$(UV) run -q --no-project --with 'cosmic-ray>=8.7' python tools/mutants/slips.py src/dqcontrol/$(FOLDER) >$(SLIPS)/slips.json
	@PYTHONPATH=src:tools/mutants $(BIN)/python -m pytest -n 0 -s -p interpreted -p mutants tests/$(FOLDER) src/dqcontrol/$(FOLDER) \
	  --slips $(SLIPS)/slips.json --seen $(SLIPS)/seen.jsonl

PEERS := $(VENV)-bench

$(PEERS)/bench: pyproject.toml
	@$(PYTHON) -m venv $(PEERS)
	@echo "installing dqcontrol's peers in $(PEERS)"
	@$(PEERS)/bin/python -m pip install --disable-pip-version-check --no-input -q '$(WITH_GROUPS)'
	@$(PEERS)/bin/python -m pip install --disable-pip-version-check --no-input -e '.[physics,robots]' --group test --group bench
	@touch $@

bench: $(PEERS)/bench
	@mkdir -p results
	@$(PEERS)/bin/python benchmarks/floor.py --json results/floor.json --picture results/floor.png
	@$(PEERS)/bin/python benchmarks/laws.py
	@$(PEERS)/bin/python benchmarks/feedforward.py
	@$(PEERS)/bin/python benchmarks/physics.py
	@$(PEERS)/bin/python benchmarks/pereira2016.py
	@$(PEERS)/bin/python benchmarks/sweep.py
	@$(PEERS)/bin/python benchmarks/recording.py
	@$(PEERS)/bin/python benchmarks/waiting.py
	@$(PEERS)/bin/python benchmarks/quadratic_programs.py
	@$(PEERS)/bin/python benchmarks/constraints.py
	@$(PEERS)/bin/python benchmarks/reactive_scenes.py

format: $(VENV)/test
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

clean:
	rm -rf $(VENV) $(PEERS) $(RELEASE) $(VENV)-oldest $(VENV)-newest dist results/demo
