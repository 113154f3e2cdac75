# rigd: `make demo` shows what it does, `make test` proves it. Both set themselves up.

VENV := .venv
BIN  := $(VENV)/bin

# Many containers set it; each command and each process of a run would compile what it imports
# anew, for seconds: uv has not compiled what it installed.
unexport PYTHONDONTWRITEBYTECODE

#: `make test K=expr`: only the tests that match, as pytest -k has it.
K :=
#: `make test-long SLICE=0/4`: a quarter of the long tests, 1/4 to 3/4: the others. With
#: `make test` that quarter comes to all that are not long.
SLICE :=
#: `make test-days`: by how many days the clock of this machine is moved.
DAYS := -30 +1 +40 +400

.PHONY: setup demo precompile test test-long contract quick test-days fmt check check-page docs bench bare lock clean

setup: $(VENV)/.ready ## make .venv with everything

# Two stages: who only looks at the demo is spared the tools of the tests, half of it all.
$(VENV)/.demo: pyproject.toml scripts/setup scripts/constraints.txt
	scripts/setup $(VENV) analysis,panel
	touch $@

$(VENV)/.ready: $(VENV)/.demo
	scripts/setup $(VENV) dev
	touch $@

demo: $(VENV)/.demo ## the campaigns of three published rigs, simulated: run, record, identify, report
	scripts/demo $(BIN)

precompile: setup ## compile what tests import once: each of the processes of `make test` would do it
	$(BIN)/pytest -q -m side_by_side --collect-only > /dev/null

#: What computes or waits for answers, side by side; then rigs in real time, two at once.
#: A room may have tests of one kind only: pytest then ends with 5.
define play
	scripts/need cc node npm chromium libatomic.so.1
	$(BIN)/pytest $(TESTS) -m "side_by_side$(1)" -n $$((3 * $$(nproc))) --dist loadfile --no-loadscope-reorder $(NONE)
	$(BIN)/pytest $(TESTS) -m "not side_by_side$(1)" -n 2 --dist loadfile --no-loadscope-reorder $(NONE)
endef
TESTS = $(addprefix tests/,$(ROOM))
NONE = $(if $(ROOM),|| [ $$? -eq 5 ])

ifeq ($(strip $(K)),)
test: export RIGD_TESTS_SLICE := $(SLICE)
test: setup ## all tests but the long ones
	$(call play,$(if $(SLICE),, and not long))
else
test: setup
	$(BIN)/pytest -k "$(K)"
endif

test-long: export RIGD_TESTS_SLICE := $(SLICE)
test-long: setup ## the long tests; tests/support/long.py lists them, with reasons
	$(call play, and long)

quick: setup ## what computes only, in less than a minute
	$(BIN)/pytest -q -m quick -n $$(nproc) --dist loadfile

contract: setup ## what the net keeps: recordings, results, pages and texts of commands, unchanged
	$(BIN)/pytest tests/contract -n $$(nproc)

test-days: export RIGD_TESTS_SLICE := $(SLICE)
test-days: setup ## what depends on the day, on other days
	scripts/need cc
	for day in $(DAYS); do \
	    echo "$$day"; \
	    scripts/at_day $$day $(BIN)/pytest -q -m dates -n $$(nproc) --dist loadfile || exit 1; \
	done

fmt: setup ## format, mend what lint can mend, write the types of the page's messages
	$(BIN)/ruff format
	$(BIN)/ruff check --fix
	$(BIN)/python scripts/page_types.py > rigd/panel/messages.d.ts

check: setup check-page ## format, lint, types, layers
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports

check-page: setup node_modules/.ready ## lint and types of the panel's page
	$(BIN)/python scripts/page_types.py | diff rigd/panel/messages.d.ts - || { echo "make fmt"; exit 1; }
	node_modules/.bin/tsc
	node_modules/.bin/eslint --max-warnings 0 rigd/panel/static/js

node_modules/.ready: package.json package-lock.json
	scripts/need node npm
	npm ci --no-audit --no-fund --ignore-scripts --silent
	touch $@

docs: setup ## the documentation as a site, with search: build/site/index.html
	$(BIN)/sphinx-build -q -W --keep-going docs build/site
	@echo "open build/site/index.html"

bench: setup ## every figure, as ratios from interleaved runs
	scripts/need cc cyclictest node npm chromium libatomic.so.1
	$(BIN)/python benchmarks/all.py

bare: ## the README's two commands on a Debian that has nothing else, in a folder (as root)
	scripts/bare "make demo" "make test"

lock: setup ## the newest versions of all libraries into the files that pin them, for .ci/run to try
	$(BIN)/uv pip compile --quiet pyproject.toml --extra dev --universal --python-version 3.11 \
	    --upgrade --no-header --no-annotate --output-file scripts/constraints.txt
	scripts/need node npm
	for folder in . tests/record/strict; do \
	    rm -f $$folder/package-lock.json; \
	    npm install --prefix $$folder --package-lock-only --omit-lockfile-registry-resolved \
	        --no-audit --no-fund --ignore-scripts --silent || exit 1; \
	done

clean: ## remove what the other targets made
	rm -rf $(VENV) build docs/reference .mypy_cache .ruff_cache .import_linter_cache .pytest_cache .hypothesis node_modules
