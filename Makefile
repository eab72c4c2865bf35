# Two commands for users: `make demo` and `make test`. Each does all its own set-up first.
SHELL := /bin/sh
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Bytecode is kept, also where the environment forbids it, as images for containers do: each of the
# many processes of a graph would compile its sources anew, for a third of its start.
export PYTHONDONTWRITEBYTECODE :=
# Everything that was built into the virtual environment is found through these two.
ENVIRONMENT := AMENT_PREFIX_PATH="$(CURDIR)/$(VENV)" LD_LIBRARY_PATH="$(CURDIR)/$(VENV)/lib"
INTERFACES := msg_schemas/CMakeLists.txt msg_schemas/package.xml $(wildcard msg_schemas/msg/*.msg msg_schemas/srv/*.srv msg_schemas/action/*.action)
SOURCES := $(shell find pianobot_ros config launch resource -type f ! -path '*/__pycache__/*' 2>/dev/null)

# Two processes for each core (tests/conftest.py); a file's tests stay together, since they share what is expensive.
PARALLEL := -n auto --maxprocesses 6 --dist loadfile --no-loadscope-reorder

.PHONY: install demo test test-all tested lint compiled format coverage colcon benchmarks reference lock clean distclean

install: $(VENV)/.installed

# The virtual environment with all locked packages. tools/create_venv.sh explains what is missing, if anything is. Python
# compiles what it imports, a part of all, when it does.
$(VENV)/.dependencies: constraints.txt pyproject.toml tools/create_venv.sh tools/requirements.py tools/install.py
	PYTHON="$(PYTHON)" sh tools/create_venv.sh $(VENV)
	$(BIN)/python -c "import sys; sys.exit(sys.version_info >= (3, 13))" || sh tools/build_ur_rtde.sh $(VENV)
	$(BIN)/python tools/install.py
	touch $@

# pianobot_msgs, generated and compiled by rosidl.
$(VENV)/.interfaces: $(VENV)/.dependencies $(INTERFACES)
	sh tools/build_interfaces.sh $(VENV)
	touch $@

# pianobot_ros itself, as a user's pip installs it, with the files that `ros2 run` looks for. Not editable: an editable
# installation leaves those out. It takes seconds, and make repeats it whenever a file changed. Newer setuptools warn of a
# licence as a table, which is the only form that those of ROS's own distribution know. What an earlier build left in
# build/lib would be installed too, modules that have moved since among it.
$(VENV)/.installed: $(VENV)/.interfaces $(VENV)/.dependencies pyproject.toml setup.py setup.cfg package.xml $(SOURCES)
	rm -rf build/lib
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --force-reinstall .
	touch $@

# What numba compiles, once for the installed package: no node of the first demo waits for it.
$(VENV)/.compiled: $(VENV)/.installed
	$(ENVIRONMENT) $(BIN)/pianobot compile
	touch $@

demo:
	$(MAKE) --no-print-directory -j 2 $(VENV)/.compiled
	$(ENVIRONMENT) $(BIN)/pianobot demo

# The same for this tree, which the tests run. It needs no messages.
compiled: $(VENV)/.dependencies
	$(ENVIRONMENT) $(BIN)/python -m pianobot_ros.cli.app compile

# Python compiles what tests and packages import (a minute on a fresh machine), pytest rewrites the tests: once here, instead
# of by each of its processes at the same time, and beside numba, which keeps one core busy for longer. What cannot be
# collected, the tests' own run tells.
$(VENV)/.collected: $(VENV)/.installed
	$(ENVIRONMENT) $(BIN)/python -m pytest --collect-only --quiet -n 0 >/dev/null 2>&1 || true
	touch $@

# Without the long tests (pyproject.toml), for which there is test-all. Types are checked beside tests that wait.
test: SELECTED := -m "not long"
test test-all:
	$(MAKE) --no-print-directory -j 2 compiled $(VENV)/.collected
	$(MAKE) --no-print-directory -j 2 lint tested SELECTED='$(SELECTED)'

tested: $(VENV)/.collected
	$(ENVIRONMENT) $(BIN)/python -m pytest $(PARALLEL) $(SELECTED) $(PYTEST_ARGUMENTS)

# All tests, with the lines that they did not reach. Takes half as long again.
coverage: install
	$(ENVIRONMENT) $(BIN)/python -m coverage erase
	$(ENVIRONMENT) $(BIN)/python -m pytest $(PARALLEL) --cov --cov-report= $(PYTEST_ARGUMENTS)
	$(BIN)/python -m coverage report --skip-covered --skip-empty

# Both packages from a workspace, as in a ROS installation, in build/colcon.
colcon: install
	cd "$(CURDIR)" && $(ENVIRONMENT) CMAKE_PREFIX_PATH="$(CURDIR)/$(VENV)" PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/colcon build \
		--paths . msg_schemas --build-base build/colcon/build --install-base build/colcon/install \
		--cmake-args -DPython3_EXECUTABLE="$(CURDIR)/$(BIN)/python" -DBUILD_TESTING=OFF

# mypy gives way to the tests beside it.
lint: $(VENV)/.dependencies
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	nice $(BIN)/mypy

format: install
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# Every figure that README.md and docs/ quote. Takes a while; each script also runs alone.
benchmarks: install
	for script in benchmarks/*.py; do echo "== $$script"; $(ENVIRONMENT) $(BIN)/python $$script || exit 1; done

# The API reference from the docstrings, in build/reference.
reference: install
	$(ENVIRONMENT) MUJOCO_GL=egl $(BIN)/python -m pdoc pianobot_ros --output-directory build/reference

# Resolve the dependencies anew for every supported Python and write constraints.txt.
lock: $(VENV)/.dependencies
	$(BIN)/python tools/lock.py > constraints.new && mv constraints.new constraints.txt

clean:
	rm -rf build install log *.egg-info .coverage* .pytest_cache .mypy_cache .ruff_cache .hypothesis

distclean: clean
	rm -rf $(VENV)
