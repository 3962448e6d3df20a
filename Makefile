# `make demo` and `make test` do everything, set-up included. PYTHON chooses the interpreter.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
SEED ?= 0
DEMO_DATA := outputs/datasets/sim_nclt$(if $(filter-out 0,$(SEED)),_seed$(SEED))

SEEDS ?= 0 1 2
comma := ,
nothing :=
space := $(nothing) $(nothing)
SWEEP := seed=$(subst $(space),$(comma),$(strip $(SEEDS))) hydra/launcher=joblib

.PHONY: help install demo ablations compare test test-slow lint bench clean

help:
	@echo "make demo       simulate, train, evaluate, print the results (SEED=0)"
	@echo "make ablations  Tables III and IV on simulated worlds (SEEDS='0 1 2'); goes on if stopped"
	@echo "make compare    all methods, Tables I and II (SEEDS='0 1'); goes on if stopped"
	@echo "make test       lint, types, import directions and the default tests"
	@echo "make test-slow  the long tests"
	@echo "make bench      all stages beside the usual routes, to outputs/bench (BENCH="--most 1000000")"
	@echo "make clean      remove .venv and caches; outputs/ stays"

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $(PYTHON) is older than Python 3.11; use make PYTHON=python3.11"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

demo: install
	$(BIN)/deepring simulate nclt --seed $(SEED) -o $(DEMO_DATA)
	$(BIN)/deepring train experiment=demo seed=$(SEED) data.root=$(DEMO_DATA)

ablations: install
	for seed in $(SEEDS); do \
	  $(BIN)/deepring simulate nclt --seed $$seed -o outputs/datasets/sim_nclt_seed$$seed || exit; \
	done
	$(BIN)/deepring train -m ablation=table3 $(SWEEP)
	$(BIN)/deepring train -m ablation=way $(SWEEP)
	$(BIN)/deepring tables outputs/sweeps/demo_table3
	$(BIN)/deepring tables outputs/sweeps/demo_way

# Two worlds of each dataset unless SEEDS says otherwise.
compare: SEEDS := $(if $(filter file,$(origin SEEDS)),0 1,$(SEEDS))
compare: install
	for seed in $(SEEDS); do for dataset in nclt mulran; do \
	  $(BIN)/deepring simulate $$dataset --seed $$seed \
	    -o outputs/datasets/sim_$${dataset}_seed$$seed || exit; \
	done; done
	$(BIN)/deepring compare --seeds $(subst $(space),$(comma),$(strip $(SEEDS))) \
	  hydra/launcher=joblib

test: install lint
	$(BIN)/python -m pytest -n 2 --dist worksteal

test-slow: install
	$(BIN)/python -m pytest -m slow

lint: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: install
	$(BIN)/python benchmarks/bench.py $(BENCH)

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
