# Two commands do everything, the set-up included: make report, make test.
# FENICSX=apt|wheel|none chooses where FEniCSx comes from (see .ci/setup.sh).

VENV ?= .venv
PEERS ?= .venv-peers
OUT ?= out
FENICSX ?=
PYTHON ?=
export VENV FENICSX PYTHON

.DEFAULT_GOAL := help
.PHONY: help setup report peers scoreboard test gate lint sanitize mutants fuzz docs site wheels view clean

help: ## print this list
	@echo "palpate: fast soft-tissue simulators, judged against FEniCSx"
	@echo
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1@\2/p' Makefile | awk -F@ '{printf "%-14s %s\n", $$1, $$2}'
	@echo
	@echo "  FENICSX=apt|wheel|none   where FEniCSx comes from (default: apt, else wheel, else none)"

setup: ## make the environment and install palpate into it
	@bash .ci/setup.sh

report: setup ## the kidney and the beam, judged: out/kidney/report.html
	@$(VENV)/bin/palpate report kidney --element both --expected -o $(OUT)/kidney
	@$(VENV)/bin/palpate report beam --element both --expected -o $(OUT)/beam

peers: ## the simulators of others that PyPI has, in an environment of their own
	@python3 -m venv $(PEERS)
	@$(PEERS)/bin/python -m pip install -q --disable-pip-version-check --upgrade pip
	@$(PEERS)/bin/python -m pip install -q --disable-pip-version-check --group peers

scoreboard: setup ## every simulator that is installed on every case: out/scoreboard/index.html
	@PALPATE_BENCH_PYTHON=$(subst $() ,:,$(wildcard $(PEERS)/bin/python /usr/bin/python3)) OMP_NUM_THREADS=1 \
	  $(VENV)/bin/palpate scoreboard -o $(OUT)/scoreboard

# On every core, without what takes long; PYTEST_ARGS takes the place of that choice.
test: setup ## run the tests that a change waits for: about 10 minutes on two cores
	@$(if $(PYTEST_ARGS),,PALPATE_MAKE_TEST=1 )$(VENV)/bin/python -m pytest \
	  $(or $(PYTEST_ARGS),-n auto --maxprocesses 8 --dist loadfile -m "not nightly and not slow and not long and not browser")

gate: setup ## every built-in verdict on both elements, held against the expected one
	@$(VENV)/bin/palpate gate --all --element both --expected

lint: setup ## format, style and type checks
	@VENV=$(VENV) bash .ci/lint.sh

sanitize: setup ## the tests of fastsim under address and undefined-behaviour sanitizers
	@bash .ci/sanitize.sh $(VENV)/bin/python

mutants: setup ## slips in the judge's own sources, 400 by a fixed seed: each must turn a test red
	@$(VENV)/bin/python -m pip install -q --disable-pip-version-check -c $(VENV)/constraints.txt --group mutants
	@bash .ci/view.sh $(VENV)/bin/python
	@$(VENV)/bin/python tests/mutants/run.py $(MUTANTS)

fuzz: setup ## mutated surfaces against the mesher, under sanitizers: FUZZ_SECONDS=60
	@FUZZ_SECONDS=$${FUZZ_SECONDS:-60} bash .ci/sanitize.sh $(VENV)/bin/python

docs: setup ## the documentation, warnings as errors: out/docs/index.html
	@$(VENV)/bin/python -m pip install -q --disable-pip-version-check -c $(VENV)/constraints.txt --group docs
	@bash .ci/docs.sh $(VENV)/bin/python $(OUT)/docs

site: scoreboard ## documentation and scoreboard as one static site: out/site/index.html
	@PALPATE_SITE=1 $(MAKE) --no-print-directory docs OUT=$(OUT)/made-site
	@rm -rf $(OUT)/site && mv $(OUT)/made-site/docs $(OUT)/site && rm -rf $(OUT)/made-site
	@cp -r $(OUT)/scoreboard $(OUT)/site/scoreboard && touch $(OUT)/site/.nojekyll

wheels: ## sdist and wheels, repaired and tried without a compiler: dist/
	@bash .ci/wheels.sh dist

view: setup ## link the sources under build/view, for work on them in place
	@bash .ci/view.sh $(VENV)/bin/python

clean: ## remove everything that was made, the environment included
	@rm -rf .venv .venv-wheel build out fastsim/_core*.so
