# `make` lists the targets. Everything is installed into .venv; nothing needs root.
PYTHON ?= python3
DATASET ?= datasets/demo.yaml
METHOD ?= spherical
METHODS ?=
VARIANTS := spherical:flow=dis spherical:first_guess=true truth
DATASETS ?= demo paper $(if $(FISHEYE_BENCH_REAL),aimotive-sample kitti-sfnd)
PROTOCOL ?= surface-v1,paper-v1
RUN ?= reports/runs/$(basename $(notdir $(DATASET)))-$(METHOD)
BASELINE ?= reports/baselines/$(basename $(notdir $(DATASET)))
TOLERANCES ?= $(if $(filter datasets/demo.yaml,$(DATASET)),rendered-v1,default-v1)

comma := ,
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed
INSTALLED_DEV := $(VENV)/installed-dev
INSTALLED_DOCS := $(VENV)/installed-docs
INSTALLED_RELEASE := $(VENV)/installed-release
FRESH := .release
export NO_MKDOCS_2_WARNING := 1
unexport PYTHONDONTWRITEBYTECODE # tests start hundreds of processes, each of which would compile what it imports

.DEFAULT_GOAL := help
.PHONY: help benchmark leaderboard paper report gate perf docs release-check test test-all coverage check format clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):[^#]*## /\1|/' | awk -F'|' '{ printf "  make %-13s %s\n", $$1, $$2 }'

benchmark: $(INSTALLED) ## score METHOD= on DATASET= (the demo) by PROTOCOL= (surface-v1,paper-v1): tables, pictures
	$(BIN)/fisheye-bench run $(DATASET) --method $(METHOD) --protocol $(PROTOCOL) --overwrite

paper: $(INSTALLED) ## rebuild reports/paper: the simulated experiment with both ego-motions, the range maps, the audit (an hour, 4 GB)
	$(BIN)/fisheye-bench run datasets/paper.yaml --no-pictures --overwrite
	$(BIN)/fisheye-bench run datasets/paper-exact.yaml --no-pictures --overwrite
	$(BIN)/fisheye-bench run datasets/range-maps.yaml --protocol extended-v1 --no-pictures --overwrite
	$(BIN)/fisheye-bench audit datasets/paper.yaml --protocol paper-v1 --recordings 42 --out reports/audit/paper
	$(BIN)/python -m benchmarks.ranking datasets/paper.yaml --recordings 21 --out reports/audit/paper
	cp reports/runs/paper-spherical/paper-v1/table.md reports/paper/table.md
	cp reports/runs/paper-exact-spherical/paper-v1/table.md reports/paper/table-exact.md
	$(BIN)/fisheye-bench report reports/runs/range-maps-spherical/extended-v1 --no-pictures
	cp reports/runs/range-maps-spherical/extended-v1/figures/range_map.png reports/paper/range_map.png
	cp reports/runs/range-maps-spherical/extended-v1/table.md reports/paper/table-range-maps.md
	cp reports/audit/paper/audit.md reports/paper/
	cp reports/audit/paper/ranking.md reports/audit/paper/ranking.png reports/paper/

gate: benchmark ## score, then judge by the baselines (BASELINE= and its -surface-v1) and TOLERANCES=
	@status=0; for by in $(subst $(comma), ,$(PROTOCOL)); do \
		end=$$(test $$by = paper-v1 || echo -$$by); echo "gate $(RUN)/$$by"; \
		$(BIN)/fisheye-bench gate $(RUN)/$$by --baseline $(BASELINE)$$end --tolerances $(TOLERANCES) \
			--junit reports/runs/gate/junit$$end.xml --json reports/runs/gate/verdict$$end.json \
			$(if $(GITHUB_ACTIONS),--github) || status=$$?; \
	done; exit $$status

leaderboard: $(INSTALLED) ## score all methods (or METHODS="a b:flow=dis") on DATASETS= (hours with paper), write reports/leaderboard
	@known="$$($(BIN)/python -c 'from bench.methods import known_methods; print(*known_methods())') $(VARIANTS)"; \
	for data in $(DATASETS); do for method in $(if $(METHODS),$(METHODS),$$known); do \
		out=reports/runs/leaderboard/$$data/$$(echo $$method | tr ':=' '--'); \
		$(BIN)/fisheye-bench run $$data --method $${method%%:*} $$(echo $$method | sed 's/^[^:]*//; s/:/ --set /g') \
			--out $$out --no-pictures --overwrite && $(BIN)/fisheye-bench report $$out/surface-v1 --no-pictures || \
			echo "not whole, or left out: $$data, $$method"; \
	done; done
	rm -rf reports/leaderboard # is made anew as a whole
	$(BIN)/fisheye-bench leaderboard reports/runs/leaderboard --out reports/leaderboard

report: $(INSTALLED) ## write the page of RUN= (the demo's)
	$(BIN)/fisheye-bench report $(RUN)

perf: $(INSTALLED_DEV) ## measure speed and memory into reports/perf.md (10 minutes)
	$(BIN)/fisheye-bench synthesize datasets/demo.scenario.yaml --out datasets/data/demo
	$(BIN)/python -m benchmarks.measure_all --card datasets/demo.yaml --out reports/perf.md

test: $(INSTALLED_DEV) ## run the tests
	$(BIN)/pytest --numprocesses auto --dist worksteal

test-all: $(INSTALLED_DEV) ## run the tests, the slow rounds among them (damaged files, kills, simulations)
	$(BIN)/pytest --numprocesses $(shell expr $$(nproc 2>/dev/null || echo 2) + 1) --dist worksteal -m "slow or not slow"

coverage: $(INSTALLED_DEV) ## run all tests as test-all does, and list what they do not cover, the least covered last (half as long again)
	$(BIN)/pytest --numprocesses $(shell expr $$(nproc 2>/dev/null || echo 2) + 1) --dist worksteal -m "slow or not slow" --cov

check: $(INSTALLED_DEV) ## format, lint, types, layers, documentation
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/mkdocs build --strict

docs: $(INSTALLED_DOCS) ## build the documentation into site/, to be read from site/index.html
	$(BIN)/mkdocs build --strict

release-check: $(INSTALLED_RELEASE) ## build dist/, check it, then score and gate the demo by the wheel, in an environment of its own
	rm -rf dist
	$(BIN)/python -m hatchling build
	$(BIN)/twine check --strict dist/*
	rm -rf $(FRESH) && $(PYTHON) -m venv $(FRESH)/venv
	$(FRESH)/venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt dist/*.whl
	cd $(FRESH) && PATH="$(CURDIR)/$(FRESH)/venv/bin:$$PATH" && unset PYTHONPATH && fisheye-bench --version --verbose && \
		fisheye-bench run demo --protocol paper-v1,surface-v1 --out run && \
		fisheye-bench gate run/paper-v1 --tolerances rendered-v1 && \
		fisheye-bench gate run/surface-v1 --tolerances rendered-v1
	rm -rf $(FRESH)

format: $(INSTALLED_DEV) ## put the code into shape
	$(BIN)/ruff format
	$(BIN)/ruff check --fix

clean: ## remove the environment, rendered data, runs and the built documentation
	rm -rf $(VENV) $(FRESH) datasets/data reports/runs reports/sweeps reports/audit site dist

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' || \
		{ echo "expected Python 3.11 to 3.14, got $$($(PYTHON) --version 2>&1); call make PYTHON=python3.11 ..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(INSTALLED): pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable .
	@touch $@

$(INSTALLED_DEV): pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $(INSTALLED) $(INSTALLED_DOCS) $@

$(INSTALLED_DOCS) $(INSTALLED_RELEASE): $(VENV)/installed-%: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing into $(VENV) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[$*]'
	@touch $(INSTALLED) $@
