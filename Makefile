# Everything runs in .venv, made by `make setup` for whatever python3 is 3.11 or 3.12.
PYTHON ?= python3
ARGS ?= # more words for the sweeps of `make reproduce`
PY := .venv/bin/python
SWEEP := model=unet,fpn,upernet,segformer
ENCODINGS := projection,negative,observed_free,stack4,stack10,exponential,ages
# of the learning curves, px:pairs:epochs; 2,000 pairs at 64 px are laptop scale, 3,000 at 128 px workstation scale
POINTS := 64:500:20 64:1000:10 64:4000:5 64:8000:5 32:2000:5 128:1000:10 128:2000:5 128:4000:5
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help setup reproduce analysis curves test test-slurm stress check bench readme clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 20

setup: .venv/ready ## make .venv and install the pinned packages

.venv/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if v in ((3, 11), (3, 12)) else f"Python 3.11 or 3.12 is needed, $(PYTHON) is {v[0]}.{v[1]}: make setup PYTHON=python3.12")'
	@echo "setting up .venv: about 6 GB, some minutes (PyTorch with CUDA is most of it)"
	@if command -v uv > /dev/null; then \
	    uv venv --quiet --clear --python "$$($(PYTHON) -c 'import sys; print(sys.executable)')" .venv; \
	    uv pip install --quiet --compile-bytecode --python $(PY) -r requirements.lock; \
	    uv pip install --quiet --python $(PY) --no-deps -e .; \
	else \
	    $(PYTHON) -m venv --clear .venv; \
	    $(PY) -m pip install --quiet --disable-pip-version-check -r requirements.lock; \
	    $(PY) -m pip install --quiet --disable-pip-version-check --no-deps -e .; \
	fi
	@touch $@

reproduce: setup ## the whole study: [SCALE=smoke|laptop|workstation|paper], paper where there is a GPU, else laptop
	@scale="$(SCALE)"; \
	echo "looking at this machine and at what is done"; \
	if [ -z "$$scale" ]; then \
	    scale=$$($(PY) -c "import torch; print('paper' if torch.cuda.is_available() else 'laptop')"); \
	    echo "SCALE is not given: taking $$scale"; \
	fi; \
	set -x; \
	$(PY) run.py task=plan scale=$$scale; \
	$(PY) run.py -m $(SWEEP) exp=1,2,3,4 scale=$$scale $(ARGS); \
	$(PY) run.py -m $(SWEEP) exp=3,4 decay=false scale=$$scale $(ARGS); \
	$(PY) run.py task=report scale=$$scale; \
	$(PY) run.py task=analysis scale=$$scale

analysis: setup ## what needs more training than the paper's study: other inputs, three seeds; other worlds: [SCALE=laptop]
	$(PY) run.py -m exp=3,4 encoding=$(ENCODINGS) seed=0,1,2 scale=$(or $(SCALE),laptop) $(ARGS)
	$(PY) run.py task=transfer exp=4 scale=$(or $(SCALE),laptop)
	$(PY) run.py task=analysis scale=$(or $(SCALE),laptop)

curves: setup ## learning curves to paper scale: U-Net with fewer pairs and pixels; 3 hours on 2 cores
	$(PY) run.py -m task=record exp=1,2,3,4 scale=laptop scale.pairs.train=8000 outputs=outputs/curves
	for point in $(POINTS); do \
	    IFS=: read -r px pairs epochs <<< "$$point"; \
	    words="scale=laptop scale.size_px=$$px scale.pairs.train=$$pairs scale.max_epochs=$$epochs \
	        recordings=outputs/curves/recordings outputs=outputs/curves/$${px}px-$$pairs"; \
	    $(PY) run.py -m exp=1,2,3,4 $$words $(ARGS); \
	    $(PY) run.py -m exp=3,4 decay=false $$words $(ARGS); \
	done
	$(PY) run.py task=curves scale=laptop

test: setup ## the tests, without GPU and network
	OMP_NUM_THREADS=1 $(PY) -m pytest -n 2 --dist loadscope

test-slurm: setup ## the sweep on a real Slurm of one node; needs root and Debian's slurm-wlm and munge
	REPRO_SLURM=1 $(PY) -m pytest tests/slurm

stress: setup ## an hour of kills, damage, generated configurations and processes at once
	REPRO_KILLS=60 REPRO_EXAMPLES=400 REPRO_ROUNDS=10 $(PY) -m pytest tests/faults

check: setup ## ruff (lint and format) and mypy
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy

bench: setup ## speed and memory as ratios to the plain way, on this machine
	$(PY) reproduce/bench

readme: setup ## make the tables of README.md anew from reproduce/results
	$(PY) run.py task=readme

clean: ## delete caches and .venv; outputs/ stays
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache build src/*.egg-info
	find . -name __pycache__ -prune -exec rm -rf {} +
