# rigd: `make demo` shows what it does, `make test` proves it. Both set themselves up.

VENV := .venv
BIN  := $(VENV)/bin

.PHONY: setup demo test check bench clean

setup: $(VENV)/.ready ## make .venv with everything

$(VENV)/.ready: pyproject.toml scripts/setup
	scripts/setup $(VENV)

demo: setup ## the campaigns of two published rigs, simulated: run, record, identify, report
	scripts/demo $(BIN)

test: setup ## the whole test suite: what may run side by side, then rigs in real time
	scripts/need node npm chromium
	$(BIN)/pytest -m side_by_side -n $$(($$(nproc) + 1)) --dist loadfile --no-loadscope-reorder
	$(BIN)/pytest -m "not side_by_side"

check: setup ## format, lint, types, layers
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup ## every figure, as ratios from interleaved runs
	scripts/need cc cyclictest node npm
	$(BIN)/python benchmarks/all.py

clean: ## remove what the other targets made
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis node_modules
