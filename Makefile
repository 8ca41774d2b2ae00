# `make fly` and `make test` are all that a user needs. Each makes the virtual environment if it is missing.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TESTED := deploy/constraints.txt
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint $(TESTED) -e
MISSION ?= missions/single_uav.yaml
CODE := schemas commd bridged agentd argosy
# Without bytecode, as under PYTHONDONTWRITEBYTECODE, each worker would rewrite the assertions of all tests: 11 s of CPU.
PYTEST := env -u PYTHONDONTWRITEBYTECODE $(BIN)/python -m pytest --dist loadfile --no-loadscope-reorder

.PHONY: fly rescue test test-all test-boards test-browser index soak faults field attacks bench docs reference pictures lint types contracts format check-python byte-code constraints clean

fly: $(VENV)/fly.stamp byte-code  ## fly the paper's first mission in simulation, with a live view
	@$(BIN)/argosy run $(MISSION) $(ARGS)

rescue: $(VENV)/fly.stamp byte-code  ## fly the paper's search and rescue on three boards' daemons, and let the referee judge
	@$(BIN)/argosy run missions/search_and_rescue.yaml --report report/rescue $(ARGS)
	@$(BIN)/argosy referee missions/search_and_rescue.yaml report/rescue

test: $(VENV)/test.stamp byte-code  ## run the tests that need nothing but Python, six files at a time, as most of them wait
	$(PYTEST) -n 6 -m "not (browser or internet or namespaces)" $(ARGS)

test-boards: $(VENV)/test.stamp byte-code  ## run the tests that make boards of network namespaces (root) or download; follow each page
	$(PYTEST) -n 4 -m "internet or namespaces" $(ARGS)

test-browser: $(VENV)/test.stamp byte-code  ## run the tests that drive chromium, two files at a time, as it computes
	$(PYTEST) -n 2 -m browser $(ARGS)

test-all: test test-boards test-browser  ## run all tests

index: $(VENV)/test.stamp  ## count the recorded exchanges that the simulated vehicles answer as the recorded ones did
	@$(BIN)/python -m tests.bridged.index_replay

soak: $(VENV)/test.stamp  ## run the tests that are too long for CI; writes docs/measurements/soak.md and docs/measurements/daemons.md
	$(BIN)/python -m tests.soak
	$(BIN)/python -m tests.soak.agreement
	nice $(BIN)/python -m tests.soak.trials
	$(BIN)/python -m tests.soak.mail
	$(BIN)/python -m tests.soak.units
	$(BIN)/python -m tests.soak.secured
	$(BIN)/python -m tests.soak.actions
	nice $(BIN)/python -m tests.soak.fuzz
	nice $(BIN)/python -m tests.soak.parser
	ARGOSY_THOROUGH=1 nice $(BIN)/python -m pytest -q -m generated

faults: $(VENV)/test.stamp  ## inject every fault of the table; writes docs/measurements/faults.md
	$(BIN)/python -m tests.faults

attacks: $(VENV)/test.stamp  ## try every attack of the table on a secured fleet, 30 s; writes docs/measurements/attacks.md
	$(BIN)/python -m tests.attacks

field: $(VENV)/test.stamp  ## let daemons fail in flight, half an hour; writes docs/measurements/faults.md
	$(BIN)/python -m tests.field $(ARGS)

bench: $(VENV)/bench.stamp byte-code  ## measure everything, two hours on a quiet machine (ARGS="bridge mail": some); writes each figure of the pages
	@$(BIN)/python -m benchmarks $(ARGS)

docs: $(VENV)/docs.stamp  ## the pages as a site in site/; a broken link fails it (--quiet would hide it from --strict)
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --site-dir site
	@! grep -rnoE '<(script|link|img|iframe)[^>]* (src|href)="?(https?:)?//[^">]*' site --include='*.html' \
	  || { echo "error: the site loads this from elsewhere"; exit 1; }

reference: $(VENV)/test.stamp  ## write docs/reference from docstrings and parsers, the overview's lines, and the grammar for editors
	$(BIN)/python -m tests.docs.stdlib_page
	$(BIN)/python -m tests.docs.commands_page
	$(BIN)/python -m tests.docs.records_page
	$(BIN)/python -m tests.docs.overview_page
	$(BIN)/python -m tests.docs.six_kinds_page
	$(BIN)/python -m tests.agentd.mind_format_page
	$(BIN)/python -m agentd.editor.textmate
	$(BIN)/python -m tests.support.texts

pictures: $(VENV)/test.stamp  ## draw docs/watch-*.svg, the screens of argosy watch in a flight of a minute
	$(BIN)/python -m tests.docs.watch_pictures

format: $(VENV)/lint.stamp  ## is every file formatted?
	$(BIN)/ruff format --check .

lint: $(VENV)/lint.stamp
	$(BIN)/ruff check .

types: $(VENV)/lint.stamp
	$(BIN)/mypy

contracts: $(VENV)/lint.stamp  ## who may import whom (docs/architecture/decisions.md)
	$(BIN)/lint-imports

# Where Python writes none (PYTHONDONTWRITEBYTECODE) each process would compile all of this for itself.
byte-code: | $(BIN)/python
	@$(BIN)/python -m compileall -q $(CODE)

check-python:
	@command -v $(PYTHON) >/dev/null || { echo "error: no $(PYTHON): sudo apt install python3 python3-venv"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "error: Python 3.11 or newer is needed, $(PYTHON) is $$($(PYTHON) -V): try make PYTHON=python3.11"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "error: no venv: sudo apt install python3-venv"; exit 1; }

$(BIN)/python: | check-python
	@echo "making a virtual environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)

$(VENV)/fly.stamp: pyproject.toml $(TESTED) | $(BIN)/python
	@echo "installing argosy"
	@$(INSTALL) '.[operator,keys,record,ui,plot]' && touch $@

$(VENV)/test.stamp: pyproject.toml $(TESTED) | $(BIN)/python
	@echo "installing argosy and what its tests need"
	@$(INSTALL) '.[operator,keys,record,ui,plot,test]' && touch $@

$(VENV)/bench.stamp: pyproject.toml $(TESTED) | $(BIN)/python
	@echo "installing argosy and the peer it is measured beside"
	@$(INSTALL) '.[operator,keys,record,ui,plot,test,bench]' && touch $@

$(VENV)/docs.stamp: pyproject.toml $(TESTED) | $(BIN)/python
	@$(INSTALL) '.[docs]' && touch $@

$(VENV)/lint.stamp: pyproject.toml $(TESTED) | $(BIN)/python
	@$(INSTALL) '.[operator,keys,record,ui,plot,test,lint]' && touch $@

constraints: | check-python  ## take the newest version of each dependency into deploy/constraints.txt; then make test-all
	@$(PYTHON) -m venv --clear $(VENV)/newest
	@$(VENV)/newest/bin/pip install --quiet --disable-pip-version-check -e '.[operator,keys,record,ui,plot,test,bench,docs,lint]'
	@sed '/^#/!d' $(TESTED) >$(VENV)/newest/$(@F)
	@$(VENV)/newest/bin/pip freeze --exclude-editable >>$(VENV)/newest/$(@F)
	@mv $(VENV)/newest/$(@F) $(TESTED) && rm -r $(VENV)/newest && git diff --stat $(TESTED)

clean:
	rm -rf $(VENV) report site
