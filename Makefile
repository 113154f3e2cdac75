# rigd: `make demo` shows what it does, `make test` proves it. Both set themselves up.

VENV := .venv
BIN  := $(VENV)/bin

#: `make test K=expr`: only the tests that match, as pytest -k has it.
K :=
#: `make test-days`: by how many days the clock of this machine is moved.
DAYS := -30 +1 +40 +400

.PHONY: setup demo test quick test-days fmt check bench clean

setup: $(VENV)/.ready ## make .venv with everything

$(VENV)/.ready: pyproject.toml scripts/setup
	scripts/setup $(VENV)

demo: setup ## the campaigns of two published rigs, simulated: run, record, identify, report
	scripts/demo $(BIN)

ifeq ($(strip $(K)),)
test: setup ## the whole test suite: what may run side by side, then rigs in real time
	scripts/need node npm chromium
	$(BIN)/pytest -m side_by_side -n $$(($$(nproc) + 1)) --dist loadfile --no-loadscope-reorder
	$(BIN)/pytest -m "not side_by_side"
else
test: setup
	$(BIN)/pytest -k "$(K)"
endif

quick: setup ## what computes only, in less than a minute
	$(BIN)/pytest -q -m quick -n $$(nproc) --dist loadfile

test-days: setup ## what depends on the day, on other days
	scripts/need cc
	for day in $(DAYS); do \
	    echo "$$day"; \
	    scripts/at_day $$day $(BIN)/pytest -q -m dates -n $$(nproc) --dist loadfile || exit 1; \
	done

fmt: setup ## format, and mend what lint can mend
	$(BIN)/ruff format
	$(BIN)/ruff check --fix

check: setup ## format, lint, types, layers
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup ## every figure, as ratios from interleaved runs
	scripts/need cc cyclictest node npm chromium
	$(BIN)/python benchmarks/all.py

clean: ## remove what the other targets made
	rm -rf $(VENV) .mypy_cache .ruff_cache .import_linter_cache .pytest_cache .hypothesis node_modules
