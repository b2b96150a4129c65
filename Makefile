# Two commands: `make demo` shows the founding example, `make test` proves the house.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.installed

# Byte code of what is imported is kept, though some machines forbid it: each of the many
# processes that tests start would translate numpy, numba and sidtool again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test lint kernels collected bench docs clean

demo: $(READY)
	$(BIN)/sidtool demo

test: $(READY)
	@$(MAKE) --no-print-directory --jobs=2 lint kernels collected
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m tests.static_checks

kernels: $(READY)
	$(BIN)/sidtool warmup $(if $(shell command -v cc),--fmu)

# Each of the two processes of pytest would translate all test files: once is enough.
collected: $(READY) lint
	@$(BIN)/python -m pytest --collect-only -q > .venv/collected.log \
		|| (cat .venv/collected.log; exit 1)

bench: $(READY)
	$(BIN)/python -m benchmarks

docs: $(READY)
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

$(READY): pyproject.toml setup.py
	@echo "setting up .venv (once)"
	@$(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --no-compile --editable '.[dev]' \
		2> .venv/install.log \
		|| (cat .venv/install.log; exit 1)
	@touch $@

clean:
	rm -rf .venv build docs/_build docs/generated *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
