# `make demo` and `make test` do all their own set-up in .venv; they need Python ≥ 3.11 and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --disable-pip-version-check --no-input

.PHONY: demo test test-all lint docs gallery chromium format bench clean
.DEFAULT_GOAL := help

help:
	@echo "make demo      drive a Panda along a drawing: two laws, servos and physics; results in results/demo"
	@echo "make test      check style and types, run the tests"
	@echo "make test-all  also the long tests"
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
	@$(PIP) -e '.[physics,robots,ros2,coppeliasim,docs,test]'
	@touch $@

chromium:
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null \
	  || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && echo "installing Chromium for the tests of the browser view (about 414 MB)" \
	    && apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium >/dev/null; } \
	  || echo "the tests of the browser view are left out; for them: apt-get install chromium" >&2

LOOK := --width 1280 --height 960 --azimuth -65 --elevation -10

demo: $(VENV)/demo
	@$(BIN)/dqcontrol run examples/demo.yaml --out results/demo --force
	@$(BIN)/dqcontrol clip results/demo/K+FF-physics results/demo.png --force $(LOOK) || true  # needs OpenGL

lint: $(VENV)/test
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/lint-imports
	@$(BIN)/pyright --project pyproject.toml

test: lint chromium
	@$(BIN)/pytest -n auto --maxprocesses 4

test-all: lint chromium
	@$(BIN)/pytest -n auto --maxprocesses 4 -m ''

docs: $(VENV)/test
	@$(BIN)/sphinx-build -W --keep-going -q docs results/docs
	@echo "results/docs/index.html"

gallery: $(VENV)/test
	@for program in $(wildcard examples/[0-9]*.py); do \
	  (cd docs/pictures/examples && "$(CURDIR)/$(BIN)/python" "$(CURDIR)/$$program") || exit 1; done

PEERS := $(VENV)-bench

$(PEERS)/bench: pyproject.toml
	@$(PYTHON) -m venv $(PEERS)
	@echo "installing dqcontrol's peers in $(PEERS)"
	@$(PEERS)/bin/python -m pip install --disable-pip-version-check --no-input -e '.[physics,robots,test,bench]'
	@touch $@

bench: $(PEERS)/bench
	@mkdir -p results
	@$(PEERS)/bin/python benchmarks/floor.py --json results/floor.json --picture results/floor.png
	@$(PEERS)/bin/python benchmarks/laws.py
	@$(PEERS)/bin/python benchmarks/physics.py
	@$(PEERS)/bin/python benchmarks/pereira2016.py
	@$(PEERS)/bin/python benchmarks/sweep.py

format: $(VENV)/test
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

clean:
	rm -rf $(VENV) $(PEERS) results/demo
