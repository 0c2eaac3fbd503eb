# What a fresh machine needs: make, libgomp1 and Python >= 3.10 with its venv module. All else goes into .venv.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Every package, direct or not, with its hashes: the same environment every day.
LOCKS := requirements
LINT := lint
PIP := -m pip --disable-pip-version-check
PIP_INSTALL := $(BIN)/python $(PIP) install --quiet --no-compile --no-deps --no-build-isolation --use-pep517
LOCKED := $(PIP_INSTALL) --require-hashes -r
# setuptools would pack what an earlier build left behind, files since removed included.
SWEEP := rm -rf build/lib build/bdist.* robot_ident.egg-info; rmdir build 2>/dev/null || true

# A sourced ROS 2, or the ROS wheels of another environment, must not reach into ours.
unexport PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH LD_LIBRARY_PATH RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE
export PYTHON
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
export OMP_NUM_THREADS := 1
# Python keeps what it has compiled in .venv: else every process that a test starts would compile all of it anew.
unexport PYTHONDONTWRITEBYTECODE
# What is installed is run, not the folder of the same name in the checkout.
export PYTHONSAFEPATH := 1

# Stamps are named after what was installed: a change of content, and nothing else, installs anew.
digest = $(firstword $(shell cat $(1) | sha256sum))
SOURCES := $(sort $(shell find robot_ident config launch resource scripts -type f ! -name '*.pyc' ! -path 'scripts/*.py'))
FRAME := setup.py setup.cfg package.xml pyproject.toml MANIFEST.in README.md
NEEDS_STAMP := $(VENV)/.needs-$(call digest,$(LOCKS)/build.txt $(LOCKS)/run.txt)
SOURCE_STAMP := $(VENV)/.source-$(firstword $(shell sha256sum $(FRAME) $(SOURCES) | sha256sum))
TOOLS_STAMP := $(VENV)/.tools-$(call digest,$(LOCKS)/*.txt)

.PHONY: help venv demo test check lint format acceptance lock clean

help:
	@echo "make venv        .venv with robot_ident and its ROS 2 nodes"
	@echo "make demo        the whole story on a simulated robot, in less than six minutes"
	@echo "make test        lint and all tests but the long ones"
	@echo "                 (NEWEST=1: with the newest of all packages that setup.py allows; OLDEST=1: with the lowest)"
	@echo "make check       lint, the tests of the rooms that a change touches, two golden commands: a minute"
	@echo "                 (make check SINCE=main: of all that differs from a commit)"
	@echo "make lint        ruff, import-linter and mypy alone (make format: let ruff lay out the code)"
	@echo "make acceptance  the long runs, hours in all; it says beforehand how long each takes"
	@echo "                 (one or some of them: make acceptance PARTS='recorder soak')"
	@echo "make lock        renews requirements/*.txt, the packages that all of these install"
	@echo "make clean       removes .venv and everything that was built"

venv: $(SOURCE_STAMP)
	@echo "$(VENV) is ready: $(BIN)/robot_ident --help"

$(NEEDS_STAMP):
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	    { echo "Python 3.10 or newer is needed; found: $$($(PYTHON) --version 2>&1); name another: make PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	    { echo "Python's venv module is missing; on Debian and Ubuntu: sudo apt-get install python3-venv" >&2; exit 1; }
	@$(PYTHON) -c 'import ctypes; ctypes.CDLL("libgomp.so.1")' 2>/dev/null || \
	    { echo "libgomp.so.1 is missing, which pinocchio needs; on Debian and Ubuntu: sudo apt-get install libgomp1" >&2; exit 1; }
	@echo "Installing robot_ident and ROS 2 Jazzy from wheels into $(VENV) (1.2 GB; half a minute to minutes)"
	$(PYTHON) -m venv --clear $(VENV)
	@$(SWEEP)
	@$(LOCKED) $(LOCKS)/build.txt
	@$(LOCKED) $(LOCKS)/run.txt
	@$(PIP_INSTALL) .
	@$(SWEEP)
	@touch $(SOURCE_STAMP) $@

$(SOURCE_STAMP): | $(NEEDS_STAMP)
	@rm -f $(filter-out $@,$(wildcard $(VENV)/.source-*))
	@[ -e $@ ] || { echo "Installing robot_ident anew (its files changed)"; $(SWEEP); \
	    $(PIP_INSTALL) --force-reinstall . && touch $@; $(SWEEP); test -e $@; }

$(TOOLS_STAMP): | $(SOURCE_STAMP)
	@echo "Installing what lint and tests need"
	@$(LOCKED) $(LOCKS)/test.txt
	@$(BIN)/python $(PIP) check
	@# A DDS of another make doesn't go with the ROS wheels in one environment.
	@$(PYTHON) -m venv --clear $(VENV)/dds
	@$(VENV)/dds/bin/python $(PIP) install --quiet --no-compile --require-hashes -r $(LOCKS)/dds.txt
	@touch $@

demo: $(SOURCE_STAMP)
	$(BIN)/robot_ident demo $(DEMO_ARGS)

lint: $(TOOLS_STAMP) $(SOURCE_STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/mypy

# What can be said of a change in a minute: what differs from the commit SINCE.
SINCE := HEAD
check: lint
	@tests=$$($(BIN)/python scripts/touched.py $(SINCE)) && export ROBOT_IDENT_TEST_INSTALLED=1 && \
	{ [ -z "$$tests" ] || $(BIN)/pytest -q -m "not long" -n auto --dist loadfile $$tests; }
	$(BIN)/python scripts/golden.py identify compare

format: $(TOOLS_STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

ifneq ($(NEWEST)$(OLDEST),)
# What the types of another numpy say of our source concerns nobody who runs it: lint goes with the locks alone.
EDGE := $(if $(NEWEST),newest,oldest)
test:
	@echo "Resolving the $(EDGE) packages that setup.py allows"
	@requirements/lock.sh .locks/$(EDGE) $(if $(OLDEST),--resolution lowest-direct) --upgrade --python "$(PYTHON)"
	@$(MAKE) --no-print-directory test VENV=.venv-$(EDGE) LOCKS=.locks/$(EDGE) NEWEST= OLDEST= LINT=
else
# The tests run on the installed package, as users have it; those of the nodes apart and two at a time, since they
# keep time, and whatever the others say: one run shows all failures. Long ones are a part of the acceptance.
test: $(TOOLS_STAMP) $(SOURCE_STAMP) $(LINT)
	@log=$$(mktemp -d) && trap 'rm -rf "$$log"' EXIT && \
	export ROS_LOG_DIR="$$log" ROBOT_IDENT_TEST_INSTALLED=1 && \
	if [ -n "$(TEST_ARGS)" ]; then $(BIN)/pytest $(TEST_ARGS); else \
	failed=0; $(BIN)/pytest -m "not long" -n auto --dist loadfile --ignore=test/nodes || failed=$$?; \
	$(BIN)/pytest -m "not long" -n 2 --dist loadfile test/nodes || failed=$$?; exit $$failed; fi
endif

acceptance: $(TOOLS_STAMP) $(SOURCE_STAMP)
	@$(BIN)/python acceptance/parts.py $(PARTS)
	@log=$$(mktemp -d) && trap 'rm -rf "$$log"' EXIT && \
	ROS_LOG_DIR="$$log" $(BIN)/pytest $$($(BIN)/python acceptance/parts.py --files $(PARTS)) -s -o faulthandler_timeout=0 $(ACCEPTANCE_ARGS)

lock:
	requirements/lock.sh requirements --universal --python-version 3.10 --upgrade

clean:
	rm -rf .venv .venv-newest .venv-oldest .locks build dist install log robot_ident.egg-info .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
	find robot_ident test launch -name __pycache__ -type d -prune -exec rm -rf {} +
