# `make demo` and `make test` set themselves up: all they want is Python 3.10 to 3.13 with venv, of
# which PYTHON names one. Whoever has ROS 2 from apt builds with colcon instead; see README.md.

PYTHON ?= python3
VENV := .venv
# A sourced ROS 2 would get in the way of the one from PyPI.
# The last: what a Python with the wheels has told its children, for example one that runs make.
CLEAN := env -u PYTHONPATH -u LD_LIBRARY_PATH -u AMENT_PREFIX_PATH -u _ROS_WHEELS_BOOTSTRAP_COMPLETE
TETRA := $(CLEAN) $(VENV)/bin/tetra
# Editable, so that a change needs no new installation; with pip's progress, as it takes a while.
INSTALL = $(CLEAN) $(VENV)/bin/python -m pip install --disable-pip-version-check -e

.PHONY: help demo test quick browser verify bench chaos power-cuts soak docs lint coverage mutants \
  clean pictures

help:  ## say what can be made
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' $(MAKEFILE_LIST)
	@echo; echo 'make PYTHON=python3.12 ... makes .venv with another Python than python3.'
	@echo "make test PYTEST_ARGS='test/formation -k gain' runs a part of the tests."

demo: $(VENV)/.ros  ## form the complete and then the rotating formation
	@echo '$$ tetra launcher --config complete'
	@$(TETRA) launcher --config complete
	@echo; echo '$$ tetra launcher --config rotating'
	@$(TETRA) launcher --config rotating
	@echo; echo 'What to do next:'
	@echo '  . $(VENV)/bin/activate                        # then there is a command tetra'
	@echo '  tetra launcher --config rotating --view     # and open the address that it prints'
	@echo '  tetra launcher --config rotating --duration 20 --record bag && tetra plot bag --out figures'

# Four files of tests at a time, as many wait more than they work; each worker is in a ROS domain
# of its own.
# PYTEST_ARGS='-n 0 -s ...' runs them one by one, and shows what they print.
PARALLEL := -n 4 --dist loadfile --no-loadscope-reorder

test: $(VENV)/.test browser  ## run all tests
	$(CLEAN) $(VENV)/bin/ruff check .
	$(CLEAN) $(VENV)/bin/mypy
	$(CLEAN) $(VENV)/bin/python -m pytest $(PARALLEL) $(PYTEST_ARGS)

quick: $(VENV)/.test  ## run the tests of the mathematics and of the files, which start no nodes
	$(CLEAN) $(VENV)/bin/ruff check .
	$(CLEAN) $(VENV)/bin/python -m pytest -n 2 test/formation test/config test/wire test/drawing

verify: $(VENV)/.test  ## check every claim of the paper
	@$(TETRA) verify

pictures: $(VENV)/.test browser  ## make the pictures of docs/ anew
	@$(CLEAN) $(VENV)/bin/python docs/pictures.py $(PICTURES)

docs: $(VENV)/.test  ## build the documentation into build/docs
	@$(CLEAN) $(VENV)/bin/sphinx-build -q -W --keep-going -d build/doctrees docs build/docs
	@echo "open build/docs/index.html"

bench: $(VENV)/.bench  ## measure it against what there is to compare with
	@$(CLEAN) $(VENV)/bin/python -m benchmarks $(BENCH_ARGS)

chaos: $(VENV)/.test  ## a thousand faults on running formations, several hosts (needs root)
	@$(CLEAN) $(VENV)/bin/python -m benchmarks.chaos $(CHAOS_ARGS)

power-cuts: $(VENV)/.test  ## kill each process of recorded formations, see what is lost
	@$(CLEAN) $(VENV)/bin/python -m benchmarks.power_cuts $(POWER_CUTS_ARGS)

soak: $(VENV)/.test  ## eight hours of a formation, and what it takes of the machine
	@$(CLEAN) $(VENV)/bin/python -m benchmarks.soak $(SOAK_ARGS)

browser:
	@for name in chromium chromium-browser google-chrome; do \
	  if command -v $$name > /dev/null; then exit 0; fi; done; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get > /dev/null; then \
	  apt-get update -qq && apt-get install -y -qq chromium > /dev/null; \
	else echo "The viewer is tested in a real browser: sudo apt install chromium" >&2; exit 2; fi

lint: $(VENV)/.test  ## check style and types
	$(CLEAN) $(VENV)/bin/ruff check .
	$(CLEAN) $(VENV)/bin/mypy

coverage: $(VENV)/.test  ## measure which branches of the mathematics and the nodes the tests run
	$(CLEAN) $(VENV)/bin/python -m pip install --quiet --disable-pip-version-check coverage
	$(CLEAN) $(VENV)/bin/coverage erase
	$(CLEAN) $(VENV)/bin/coverage run -m pytest $(PARALLEL) $(PYTEST_ARGS)
	$(CLEAN) $(VENV)/bin/coverage combine --quiet
	$(CLEAN) $(VENV)/bin/coverage report --show-missing \
	  --include='tetra_ros2/formation/*,tetra_ros2/wire/*,tetra_ros2/nodes/*'

# It goes on where it was stopped. MUTANTS_ARGS='--sample 500 --seed 1 --time 3600 formation/law.py'
mutants: $(VENV)/.test  ## change the mathematics a little, many times, and see the tests fail
	@$(CLEAN) $(VENV)/bin/python -m pip install --quiet --disable-pip-version-check \
	  'cosmic-ray>=8.7' pytest-cov
	@$(CLEAN) $(VENV)/bin/python -m benchmarks.mutants $(MUTANTS_ARGS)

clean:  ## remove what was made here
	rm -rf $(VENV) build install log mutants .pytest_cache .ruff_cache .hypothesis *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' || \
	  { echo "Python 3.10 to 3.13 is needed, $(PYTHON) is $$($(PYTHON) --version 2>&1);" \
	    "name another: make PYTHON=python3.12 ..." >&2; exit 2; }
	@$(PYTHON) -m venv $(VENV) || \
	  { rm -rf $(VENV); echo "venv is missing: apt install python3-venv" >&2; exit 2; }

$(VENV)/.ros: setup.py tetra_ros2/installation.py | $(VENV)/bin/python
	@echo 'Into $(VENV), from PyPI: ROS 2 (rclpy, Fast DDS), the viewer, matplotlib, MuJoCo;'
	@echo 'some 140 MB to download, 550 MB on disk.'
	$(INSTALL) '.[ros,record,plot,view,physics,completion]'
	@touch $@

$(VENV)/.test: setup.py tetra_ros2/installation.py | $(VENV)/bin/python
	@echo 'Into $(VENV), from PyPI: all that the tests want, 1.5 GB on disk.'
	$(INSTALL) '.[ros,test]'
	@touch $@ $(VENV)/.ros

$(VENV)/.bench: setup.py tetra_ros2/installation.py | $(VENV)/bin/python
	$(INSTALL) '.[ros,record,bench]'
	@touch $@
