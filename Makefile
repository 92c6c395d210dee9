# Every target sets up what it needs into .venv and is quick when that is already done.
PY ?= python3
VENV := .venv
BIN := $(VENV)/bin
# What running needs, and what testing, evaluating and fitting need besides: one lock each.
STAMP := $(VENV)/.installed
DEV_STAMP := $(VENV)/.installed-dev
SPARK_STAMP := $(VENV)/.installed-spark
DATA ?= ../shared/data
export RLEEX_TEST_DATA ?= $(abspath $(DATA))
export TF_CPP_MIN_LOG_LEVEL ?= 3
# A session starts five interpreters: let them read compiled modules.
unexport PYTHONDONTWRITEBYTECODE

# A third of the tests' time is waiting, for screens and threads; collecting all tests only to choose takes long, too.
WORKERS = $(shell echo $$(($$(nproc) * 3 / 2)))
SERIAL = $(shell grep -rlF pytest.mark.serial --include='test_*.py' tests)
# A test that hangs ends its worker after a while (pyproject.toml); a new worker would begin with it again.
PYTEST = $(BIN)/python -m pytest -q --max-worker-restart 0

.PHONY: run demo test compile-tests test-can test-spark test-serial check lock evaluate bench mutation coverage pictures system model clean

run: model
	@$(BIN)/rleex run

demo: model
	@$(BIN)/rleex demo

# What uses one core runs beside something else. Real sessions leave a third of two cores, which the checks take at the
# lowest priority.
test: $(DEV_STAMP) model
	@echo "The tests on a kernel's CAN bus and those on a Spark cluster (2 min) …"
	@$(MAKE) --no-print-directory -j3 --output-sync=line test-can compile-tests test-spark
	@$(PYTEST) -m "not serial" -n $(WORKERS) --dist loadfile
	@$(MAKE) --no-print-directory -j2 test-serial check NICE="nice -n 19"

test-serial: $(DEV_STAMP) model
	@$(PYTEST) -m serial -n 2 --dist loadgroup $(SERIAL)

check: $(DEV_STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(NICE) $(BIN)/mypy app hal kgdfa logs profiles testing tests tools
	@$(NICE) $(BIN)/lint-imports --no-logo

# Else each of the workers compiles them at the same moment.
compile-tests: $(DEV_STAMP)
	@$(PYTEST) --collect-only -p no:syrupy | tail -n 1

test-can: $(DEV_STAMP) model
	@tools/test-can

test-spark: $(SPARK_STAMP)
	@tools/test-spark

evaluate: $(DEV_STAMP) model
	@$(BIN)/rleex evaluate gestures $(DATA)/gestures
	@$(BIN)/rleex evaluate distance $(DATA)/distance
	@$(BIN)/rleex evaluate trigger
	@$(BIN)/rleex evaluate speed $(DATA)/distance

bench: $(DEV_STAMP) model
	@$(BIN)/python tools/bench.py

coverage: $(DEV_STAMP)
	@$(BIN)/python -m pytest -q tests/app/control tests/hal/joints/test_guard.py --cov-branch --cov-report=term-missing \
	    --cov=app.control --cov=hal.joints.guard

mutation: $(DEV_STAMP)
	@tools/mutation

pictures: $(DEV_STAMP) model
	@$(BIN)/python tools/pictures.py
	@$(BIN)/python tools/screen_sheets.py

# As few versions of a package as its wheels allow, over all Pythons (docs/decisions.md).
LOCK := $(BIN)/uv pip compile pyproject.toml --universal --python-version 3.11 --overrides tools/overrides.txt \
    --fork-strategy fewest --generate-hashes --no-emit-index-url --no-emit-find-links --no-annotate --no-header
lock: $(DEV_STAMP)
	@$(LOCK) --extra dev --extra realsense -o requirements-dev.lock
	@$(LOCK) --extra build --extra realsense --constraint requirements-dev.lock -o requirements.lock
	@$(LOCK) --extra analysis --extra spark --constraint requirements-dev.lock -o requirements-spark.lock

system:
	@tools/system-packages

INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps

# An interrupted venv has no pip: it is made anew.
$(STAMP): requirements.lock pyproject.toml | system
	@$(BIN)/python -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	    || $(PY) -m venv --clear $(VENV)
	@echo "Setting up $(VENV) (once) …"
	@$(INSTALL) --require-hashes -r requirements.lock
	@$(INSTALL) --no-build-isolation -e .
	@touch $@

$(DEV_STAMP): requirements-dev.lock $(STAMP)
	@echo "Setting up what the tests need (once) …"
	@$(INSTALL) --no-compile --require-hashes -r requirements-dev.lock
	@touch $@

# Spark comes to a machine through `make test` and `make test-spark` only.
$(SPARK_STAMP): requirements-spark.lock $(DEV_STAMP)
	@echo "Setting up Spark (once, 430 MB) …"
	@$(INSTALL) --no-compile --require-hashes -r requirements-spark.lock
	@touch $@

# The catalogues as gettext reads them.
model: $(STAMP)
	@$(BIN)/python -m app.text.compile
	@$(BIN)/rleex model --quiet

clean:
	@rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis mutants build dist
