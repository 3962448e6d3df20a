# `make demo` and `make test` do everything, set-up included. PYTHON chooses the interpreter.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
DOCS_INSTALLED := $(VENV)/.docs-installed
SEED ?= 0
DEMO_DATA := outputs/datasets/sim_nclt$(if $(filter-out 0,$(SEED)),_seed$(SEED))

MUTANTS ?=
INPUTS ?= 20000
SEEDS ?= 0 1 2
comma := ,
nothing :=
space := $(nothing) $(nothing)
SWEEP := seed=$(subst $(space),$(comma),$(strip $(SEEDS))) hydra/launcher=joblib

.PHONY: help install demo ablations compare worlds weights test test-slow docs docs-test kill fuzz lint \
  coverage mutation hooks bench peers release-check clean

help:
	@echo "make demo       simulate, train, evaluate, print the results (SEED=0)"
	@echo "make ablations  Tables III and IV on simulated worlds (SEEDS='0 1 2'); resumes if stopped"
	@echo "make compare    all methods, Tables I and II (SEEDS='0 1'); resumes if stopped"
	@echo "make worlds     simulate the worlds that the network learns from, and those it is chosen by"
	@echo "make weights    train the network that comes with the package, on separate worlds"
	@echo "make test       lint, types, import directions and the default tests"
	@echo "make test-slow  the long tests"
	@echo "make docs       the docs as a site, to outputs/site"
	@echo "make docs-test  build it, check its links, follow its tutorials, run its notebooks"
	@echo "make kill       kill every long command at random instants, and start it again (KILLS=20)"
	@echo "make lint       formatting, lint, types and import directions, without tests"
	@echo "make coverage   the default tests with coverage of the package, lines and branches"
	@echo "make mutation   mutants of core/ and the metrics that no test kills (MUTANTS='deepring.core.radon*')"
	@echo "make fuzz       damaged and forged files of every format (SEEDS='0 1 2' INPUTS=20000)"
	@echo "make hooks      run make lint's checks before every commit (pre-commit)"
	@echo "make bench      all stages beside the usual routes, to outputs/bench (BENCH='--most 1000000')"
	@echo "make peers      beside map-closures, kiss-matcher and small_gicp, to outputs/peers (PEERS='kitti=FOLDER')"
	@echo "make release-check  wheel and sdist, each Python, lowest versions, each extra (CHECK=--help)"
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
	$(BIN)/deepring train -m sweep=table3 $(SWEEP)
	$(BIN)/deepring train -m sweep=way $(SWEEP)
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

# The worlds of conf/worlds/weights.txt train the network; worlds 110 and 111 choose it, and tell when to
# trust it. In the odd one buildings are of more kinds, the campus has a blind sector and the city none.
worlds: install
	while read -r seed knobs; do \
	  $(BIN)/deepring simulate custom --seed $$seed -o outputs/datasets/weights_$$seed \
	    train_columns=3 test_columns=2 scan_spacing=4 azimuths=450 $$knobs < /dev/null || exit; \
	done < conf/worlds/weights.txt
	for seed in 110 111; do \
	  odd=; city=; case $$seed in *[13579]) \
	    odd="building_prototypes=8 blind_width_deg=90"; city="building_prototypes=8 blind_width_deg=0";; \
	  esac; \
	  $(BIN)/deepring simulate nclt --seed $$seed -o outputs/datasets/weights_nclt_$$seed \
	    train_columns=3 test_columns=2 $$odd || exit; \
	  $(BIN)/deepring simulate mulran --seed $$seed -o outputs/datasets/weights_mulran_$$seed \
	    train_columns=3 test_columns=2 $$city || exit; \
	done

weights: worlds
	$(BIN)/deepring train experiment=weights
	$(BIN)/python benchmarks/localization.py --checkpoint outputs/weights/latest/checkpoints/last.ckpt \
	  --whole --every 2 --calibrate 0.998 sim_nclt=outputs/datasets/weights_nclt_110 \
	  sim_nclt=outputs/datasets/weights_nclt_111 sim_mulran=outputs/datasets/weights_mulran_110 \
	  sim_mulran=outputs/datasets/weights_mulran_111

test: install lint
	$(BIN)/python -m pytest -n 2 --dist worksteal

test-slow: install
	$(BIN)/python -m pytest -m slow

# Warnings are errors; no network is needed once the packages are installed.
$(DOCS_INSTALLED): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	@touch $@

docs: $(DOCS_INSTALLED)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict
	@echo "outputs/site/index.html; $(BIN)/python -m http.server -d outputs/site serves it, with its search"

docs-test: $(DOCS_INSTALLED)
	$(BIN)/python -m pytest -m docs tests/docs

KILLS ?= 20
kill: install
	KILLS=$(KILLS) $(BIN)/python -m pytest -m kill -s tests/kill

lint: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

coverage: install
	$(BIN)/python -m pytest -n 2 --dist worksteal --cov --cov-report=term:skip-covered

# mutants/ holds a changed copy of the package and the results; delete it to begin anew.
mutation: install
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[mutation]'
	$(BIN)/mutmut run $(MUTANTS)
	$(BIN)/mutmut results | grep -v 'not checked'

fuzz: SEEDS := $(if $(filter file,$(origin SEEDS)),0,$(SEEDS))
fuzz: install
	OMP_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python -m fuzz --seeds $(SEEDS) --inputs $(INPUTS)

hooks: install
	$(BIN)/pre-commit install

bench: install
	$(BIN)/python benchmarks/bench.py $(BENCH)

# The peers and what they need stay out of .venv.
PEERS ?=
PEERS_VENV := .venv-peers
PEERS_INSTALLED := $(PEERS_VENV)/.installed

$(PEERS_INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(PEERS_VENV)
	$(PEERS_VENV)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt \
	  -e '.[peers]'
	@touch $@

peers: $(PEERS_INSTALLED)
	OMP_NUM_THREADS=1 $(PEERS_VENV)/bin/python benchmarks/peers.py $(PEERS)

# CHECK takes options, such as --pythons 3.11 --parts lowest; python -m release --help lists them.
CHECK ?=
RELEASE_VENV := .venv-release

$(RELEASE_VENV)/.installed: Makefile
	$(PYTHON) -m venv $(RELEASE_VENV)
	$(RELEASE_VENV)/bin/python -m pip install --quiet --disable-pip-version-check \
	  'build>=1.2' 'hatchling>=1.25' 'twine>=6' 'cffconvert>=2' 'packaging>=23'
	@touch $@

release-check: $(RELEASE_VENV)/.installed
	$(RELEASE_VENV)/bin/python -m release $(CHECK)

clean:
	rm -rf $(VENV) $(PEERS_VENV) $(RELEASE_VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache \
	  .coverage* htmlcov mutants
