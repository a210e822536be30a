# Each target does one thing; continuous integration calls the same ones.
# Paths are relative throughout, so a checkout may be in a folder whose name has spaces.

PYTHON ?= python3
MODEL  ?= paper
ARGS   ?=

run = .venv/bin/python -m

.PHONY: help simulate test regenerate check coverage lint format bench bench-smoke docs site lock \
	environment environment-dev environment-bench clean
.DEFAULT_GOAL := help

help: ## list the targets
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | sort | expand -t 14

simulate: environment ## the model's closed loop: table, figures and data under runs/ (MODEL=paper ARGS="--set c1=20")
	@$(run) pmjoint_codegen simulate $(MODEL) $(ARGS)

test: environment-dev ## the test suite (ARGS="-k taylor")
	@$(run) pytest $(ARGS)

regenerate: environment ## rewrite generated/ from the model files
	@$(run) pmjoint_codegen regenerate $(ARGS)

check: environment ## check generated/ against the models: staleness, proofs, error bounds, trajectories, compilers
	@$(run) pmjoint_codegen check $(ARGS)

coverage: environment-dev ## branch coverage of the derivation and of what checks it; at least 95 %
	@$(run) pytest -q tests/derive tests/check tests/cli/test_check.py --cov=pmjoint_derive --cov=pmjoint_codegen.check \
		--cov-branch --cov-report=term-missing:skip-covered --cov-fail-under=95 $(ARGS)

lint: environment-dev ## style and types
	@$(run) ruff check --quiet
	@$(run) ruff format --check --quiet
	@$(run) mypy --no-error-summary

format: environment-dev ## format the source
	@$(run) ruff format --quiet
	@$(run) ruff check --quiet --fix

bench: environment-bench ## benchmarks against public tools, side by side in one run; installs those tools
	@$(run) benchmarks $(ARGS)

bench-smoke: environment-dev ## a short run of every benchmark with the installed tools; measures nothing
	@$(run) benchmarks --quick

docs: environment-dev ## draw docs/figures (make bench draws its own) and rewrite docs/audit.md
	@$(run) docs.draw
	@$(run) docs.gallery
	@$(run) pmjoint_codegen audit --format markdown --out docs/audit.md

# Not with --quiet: what it hides is not counted as an error either. NO_MKDOCS_2_WARNING: a notice of a successor.
site: environment-dev ## build the documentation as a site in site/: offline, every warning an error
	@NO_MKDOCS_2_WARNING=1 $(run) mkdocs build

# UPGRADE=--upgrade takes the newest versions that pyproject.toml allows; without it, pins stay where possible.
# Extras stay in the locks: an old pip treats `coverage[toml]` as a different requirement from `coverage==...`.
pin = UV_CUSTOM_COMPILE_COMMAND="make lock" $(run) uv pip compile --quiet --universal --python-version 3.11 \
	--generate-hashes --no-emit-index-url --no-strip-extras $(UPGRADE)
extras = $(addprefix --extra ,test dev docs sweep control compiler fmu logs terminal)
compile = $(pin) --group editable --extra derive pyproject.toml

lock: environment-dev ## pin every dependency, and the pip that installs them, with its hashes in requirements/
	@$(pin) --group installer --output-file requirements/installer.txt
	@$(compile) --output-file requirements/simulate.txt
	@$(compile) $(extras) --constraint requirements/simulate.txt --output-file requirements/dev.txt
	@$(compile) $(extras) --extra bench --constraint requirements/dev.txt \
		--output-file requirements/bench.txt

environment:
	@$(PYTHON) tools/environment.py simulate

environment-dev:
	@$(PYTHON) tools/environment.py simulate dev

environment-bench:
	@$(PYTHON) tools/environment.py simulate dev bench

clean: ## remove .venv, runs and caches
	@rm -rf .venv runs site build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis .coverage .coverage.*
