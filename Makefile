# Every target sets up what it needs into .venv and is quick when that is already done.
PY ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DATA ?= ../shared/data
export TF_CPP_MIN_LOG_LEVEL ?= 3

.PHONY: run demo test test-can check lock evaluate bench mutation coverage pictures system model clean

run: model
	@$(BIN)/rleex run

demo: model
	@$(BIN)/rleex demo

test: check model
	@$(BIN)/python -m pytest -q

check: $(STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy app hal kgdfa logs profiles testing tests tools
	@$(BIN)/lint-imports --no-logo

test-can: model
	@tools/test-can

evaluate: model
	@$(BIN)/rleex evaluate gestures $(DATA)/gestures
	@$(BIN)/rleex evaluate distance $(DATA)/distance
	@$(BIN)/rleex evaluate trigger
	@$(BIN)/rleex evaluate speed $(DATA)/distance

bench: model
	@$(BIN)/python tools/bench.py

coverage: $(STAMP)
	@$(BIN)/python -m pytest -q tests/app/control tests/hal/joints/test_guard.py --cov-branch --cov-report=term-missing \
	    --cov=app.control --cov=hal.joints.guard

mutation: $(STAMP)
	@tools/mutation

pictures: model
	@$(BIN)/python tools/pictures.py

model: $(STAMP)
	@$(BIN)/rleex model --quiet

lock: $(STAMP)
	@$(BIN)/uv pip compile pyproject.toml --extra realsense --extra dev --universal --python-version 3.11 \
	    --overrides tools/overrides.txt --generate-hashes --no-emit-index-url --no-emit-find-links \
	    --no-annotate --no-header -o requirements.lock

system:
	@tools/system-packages

$(STAMP): requirements.lock pyproject.toml | system
	@test -x $(BIN)/python || $(PY) -m venv $(VENV)
	@echo "Setting up $(VENV) (once) …"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r requirements.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

clean:
	@rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis mutants build dist
