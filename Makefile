# `make` alone prints what there is. What needs root asks for it by sudo; the rest does not.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help setup packages run-sdc run-teleport run-distribute run-swap run-qkd cli test \
    test-docker lint types unit emulation bench curves image clean lock browser

PYTHON := .venv/bin/python
# The caches and byte code of root would be in the user's way.
AS_ROOT = $(if $(filter-out 0,$(shell id -u)),sudo env PYTHONDONTWRITEBYTECODE=1)
PYTEST := $(PYTHON) -m pytest -p no:cacheprovider
PRODUCT := wire dispatcher hosts controller_apps qswitch_agent copper topologies qmn
PROTOCOLS := $(patsubst %.proto,%,$(wildcard wire/*.proto))
GENERATED := $(foreach end,_pb2.py _pb2.pyi _pb2_grpc.py,$(addsuffix $(end),$(PROTOCOLS)))

# The values reach the program as they were typed: make expands no $ in them, and they
# travel in the environment, past every shell.
OPTIONS := MESSAGE FILE HANDSHAKE FEC INTERLEAVE SEED CONTROLLER MODE TOPO CAPTURE \
    PROTOCOL STATE BACKEND COUNT DEPOLARIZING EVE FIDELITY REPEATERS SCHEDULE
$(foreach name,$(OPTIONS),$(if $(filter-out undefined,$(origin $(name))),\
    $(eval override $(name) := $$(value $(name)))$(eval export $(name))))

help: ## Print this help
	@sed -n 's/^\([a-z-]*\):.*## /  \1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 18
	@printf '%s\n' '' 'Variables of run-sdc:' \
	    '  MESSAGE=TEXT    What alice sends (default: a short text)' \
	    '  FILE=PATH       Send this file instead' \
	    '  HANDSHAKE=...   framed (default: one for the session) or per-pair (as in the paper)' \
	    '  FEC=...         none (default), repetition, hamming, golay or reed-solomon' \
	    '  INTERLEAVE=1    Spread the codewords of FEC over a frame' \
	    '' 'Variables of run-teleport, run-distribute, run-swap and run-qkd:' \
	    '  STATE=...       run-teleport: 0, 1, +, -, +i, -i or random (default);' \
	    '                  with BACKEND=dense also haar, or angles THETA,PHI as pi/3,0.5' \
	    '  BACKEND=...     run-teleport: chp (default), stim or dense' \
	    '  FIDELITY=F      run-distribute, run-swap: of the pairs, at least (default: any)' \
	    '  REPEATERS=N     run-swap: 1 (default) to 16' \
	    '  SCHEDULE=...    run-swap: parallel (default), left-to-right or nested' \
	    '  PROTOCOL=...    run-qkd: bb84 (default) or bbm92' \
	    '  EVE=FRACTION    run-qkd: of the photons, measured by eve on the fibre' \
	    '  COUNT=N         States to teleport, pairs, or sifted bits to make a key of' \
	    '  DEPOLARIZING=P  Of every fibre (default: 0)' \
	    '' 'Variables of cli:' \
	    '  TOPO=...        sdc (default), chain, ring, leaf-spine, repeaters or tapped' \
	    '  CAPTURE=1       Capture packets, as run-sdc does' \
	    '' 'Variables of all:' \
	    '  SEED=N          Makes the random draws repeatable' \
	    '  CONTROLLER=...  ryu (default) or os-ken' \
	    '  MODE=...        docker, native or auto (default: docker if an engine answers)'

# Programs of root leave no byte code here: without this they would compile at each start.
setup: packages $(GENERATED) ## Install what is missing; a second time does nothing
	@$(PYTHON) -m compileall -q $(PRODUCT)

run-sdc: ## Send a message from alice to bob by superdense coding
	@setup/run-sdc

run-teleport: ## Teleport states from alice to bob
	@setup/run-teleport

run-distribute: ## Put pairs into the memories of alice and bob
	@setup/run-distribute

run-swap: ## The same by way of repeaters, which swap entanglement
	@setup/run-swap

run-qkd: ## Make secret keys that alice and bob share
	@setup/run-qkd

cli: ## Start a network with a command line
	@setup/cli

test: setup lint types unit emulation ## Run all checks and tests natively

test-docker: ## Run the emulation tests inside the image
	@docker/run $(PYTEST) tests/emulation

lint: setup ## Check style and formatting
	$(PYTHON) -m ruff check
	$(PYTHON) -m ruff format --check

types: setup ## Check types
	$(PYTHON) -m mypy

unit: setup browser ## Run the unit tests (no root)
	$(PYTEST) tests/unit

emulation: setup ## Run the emulation tests (root, Open vSwitch)
	$(AS_ROOT) $(PYTEST) tests/emulation

bench: setup ## Measure and print the speed of this machine
	$(AS_ROOT) $(PYTHON) -m qmn bench

curves: setup ## Check the physics against theory and draw it (curves/)
	$(PYTHON) -m qmn curves

image: ## Build the Docker image
	@docker/build

clean: ## Remove what was built here (not runs/)
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache $(GENERATED)
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

lock: ## Choose new versions of the Python packages
	@setup/lock

packages:
	@setup/packages apt-packages.txt

browser:
	@setup/browser

.venv/complete: requirements.lock ryu.lock build-constraints.txt | packages
	@setup/environment

%_pb2.py %_pb2.pyi %_pb2_grpc.py: %.proto .venv/complete
	@$(PYTHON) -m grpc_tools.protoc -I. --python_out=. --pyi_out=. --grpc_python_out=. $<
