# `make` alone prints the targets. Only targets that need root ask for it, by sudo.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help setup installed packages strongswan notebooks install uninstall run-sdc test test-docker lint types unit \
    emulation test-swarm commands nightly mutants chaos fuzz bench live-speed curves labs pictures recording lab-pictures site release image clean \
    lock browser q0-programs house

PYTHON := .venv/bin/python
# The caches and byte code of root would be in the user's way.
AS_ROOT = $(if $(filter-out 0,$(shell id -u)),sudo env PYTHONDONTWRITEBYTECODE=1)
# PARTS: processor seconds of what ran before (setup/part).
# OpenBLAS has one thread, as in the programs of a network: more would spin, and take tests' time.
PYTEST := env PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 'PARTS=$(PARTS)' $(PYTHON) -m pytest -p no:cacheprovider -p progress -p garbage -p nightly -p default_signals -p limits
# More processes than processors, as long as all has room, because tests wait for time or other
# processes. Of unit tests half as many more: each process imports and collects everything, which takes
# it as long as hundreds of tests. Of those that emulate networks three times as many, of which a third
# begins with tests that mostly wait: more would be too many for the deadlines of networks, which are
# of a machine that has time for them. They have namespaces of their own, as a network has fixed names
# and addresses.
PROCESSES = $(shell n=$$(getconf _NPROCESSORS_ONLN); echo $$(( n < 8 ? n : 8 )))
AT_A_TIME = $$(( (3 * $(PROCESSES) + 1) / 2 ))
NETWORKS = $$(( 3 * $(PROCESSES) ))
# One that dies is not replaced: another would have other files.
IN_PARALLEL = --numprocesses=$(AT_A_TIME) --dist=each -p files_of_workers --max-worker-restart=0
# Of unit tests and networks; make nightly has the others.
WHEN := not nightly
# Half of collecting is to compile tests, unless they leave their byte code for the next time.
WITH_BYTE_CODE = env PYTHONDONTWRITEBYTECODE=
# One that fails is repeated alone: tests/late.py.
APART = --dist=worksteal --tx="$(NETWORKS)*popen//python=topologies/own_namespaces $(PYTHON)" \
    -p late --alone=topologies/own_namespaces
# Their files are in a folder with a short path, as sockets need; it stays if a test fails.
in_folder = folder=$$(mktemp -d /tmp/qmn.XXXX) && \
    $1 $(PYTEST) --basetemp="$$folder" $2 && $1 rm -r "$$folder"
TESTS := tests/emulation -m 'image and not nightly'  # of test-docker; TESTS=tests/emulation for all
# Notebooks' packages and a browser are large, and not in the image; and Docker lets no process take
# files of others, nor make groups of processes.
IN_GROUPS := several_together_do_not_take_more who_takes_more_does_not_go_on_by_swapping \
    what_a_killed_run_leaves_goes_with_the_next
TAKE_FILES := heavy_traffic_of_a_host_on_a_second_machine_is_that_of_one_machine \
    a_worker_that_is_killed_ends_the_run_by_name_and_leaves_nothing[open-vswitch]
NOT_IN_IMAGE := $(patsubst %,--ignore=tests/emulation/test_%.py,notebooks held_packet_sockets \
    live_page_in_browser) \
    $(patsubst %,--deselect=tests/emulation/test_memory_shares.py::test_%,$(IN_GROUPS)) \
    $(patsubst %,--deselect=tests/emulation/test_several_machines.py::test_%,$(TAKE_FILES))
PRODUCT := wire programs dispatcher hosts controller_apps qswitch_agent copper topologies qmn \
    applications evidence views
PROTOCOLS := $(patsubst %.proto,%,$(wildcard wire/*.proto))
GENERATED := $(foreach end,_pb2.py _pb2.pyi _pb2_grpc.py,$(addsuffix $(end),$(PROTOCOLS)))

# The values reach the program as they were typed: make expands no $ in them, and they
# travel in the environment, past every shell. ARGS is for the shell, as a command line is.
$(foreach name,MESSAGE FILE MODE PREFIX DESTDIR,$(if $(filter-out undefined,$(origin $(name))),\
    $(eval override $(name) := $$(value $(name)))$(eval export $(name))))

help: ## Print this help
	@sed -n 's/^\([a-z-]*\):.*## /  \1\t/p' $(firstword $(MAKEFILE_LIST)) | expand -t 18
	@printf '%s\n' '' 'Variables of run-sdc:' \
	    '  MESSAGE=TEXT    What alice sends (default: a short text)' \
	    '  FILE=PATH       Send this file instead' \
	    '  ARGS="..."      Further options of `qmn run sdc`, as ARGS="--fec golay --seed 7"' \
	    '  MODE=...        docker, native or auto (default: docker if an engine answers)' \
	    '' 'Variable of install and uninstall:' \
	    '  PREFIX=FOLDER   Where to (default: /usr/local)' \
	    '' 'All other options are those of `qmn` itself: bin/qmn --help'

# Programs of root leave no byte code here: without this they would compile at each start.
setup: ## Install what is missing; a second time does nothing
	@flock --nonblock setup true || echo 'setup: waiting for another make in this folder'
	@flock --timeout 3600 setup $(MAKE) --no-print-directory installed

# By one make at a time in one tree: each would delete the other's .venv.
installed: packages $(GENERATED)
	@$(PYTHON) -m compileall -q $(PRODUCT)

install: setup ## Put `qmn` on the PATH, with completion and a manual page
	@setup/install

uninstall: ## Take that away again
	@setup/install --remove

run-sdc: ## Send a message from alice to bob by superdense coding
	@setup/run-sdc $(value ARGS)

test: setup ## Run all checks and tests natively
	@echo 'test: style and types, then tests: about 14 minutes on two processors'
	@source setup/part; \
	part style $(MAKE) --no-print-directory lint types; \
	echo 'test: unit tests; about 13 minutes left'; \
	part units $(MAKE) --no-print-directory unit; \
	echo 'test: tests in emulated networks; about 9 minutes left'; \
	$(MAKE) --no-print-directory emulation

test-docker: ## Run the emulation tests marked `image` inside it (DEBIAN=13: of Debian 13)
	@docker/run $(PYTEST) $(APART) $(NOT_IN_IMAGE) $(TESTS)

test-swarm: setup ## Try several machines with two Docker engines and Docker Swarm (root)
	$(AS_ROOT) $(PYTEST) tests/swarm

lint: setup ## Check style and formatting
	$(PYTHON) -m ruff check
	$(PYTHON) -m ruff format --check

types: setup ## Check types
	$(PYTHON) -m mypy

unit: setup browser notebooks ## Run the unit and contract tests (no root)
	@$(call in_folder,$(WITH_BYTE_CODE),-m '$(WHEN)' $(IN_PARALLEL) tests/unit tests/contract)
	@echo 'unit: handlers of the controller on os-ken, too: a process loads one framework'
	@QMN_CONTROLLER_FRAMEWORK=os-ken $(WITH_BYTE_CODE) $(PYTEST) tests/unit/controller_apps/handlers

emulation: setup strongswan q0-programs browser notebooks ## Run the emulation tests (root, Open vSwitch)
	@$(call in_folder,$(AS_ROOT),-m '$(WHEN)' $(APART) tests/emulation)

# Beside all tests of the day. Both images whole, one after the other, as by day.
nightly: setup browser notebooks ## Run what is left out by day, some hours: before a release
	@$(call in_folder,$(WITH_BYTE_CODE),-m nightly $(IN_PARALLEL) tests/unit)
	@$(MAKE) --no-print-directory emulation WHEN=nightly
	@$(MAKE) --no-print-directory chaos MINUTES=120 STRIKES=1000
	@$(MAKE) --no-print-directory chaos LEAPS=100000
	@$(MAKE) --no-print-directory commands mutants
	@for debian in 12 13; do \
	    DEBIAN=$$debian $(MAKE) --no-print-directory image test-docker TESTS=tests/emulation; \
	done

chaos: setup ## Strike runs at random for MINUTES (3), from SEED (1): nothing may hang, lie or stay
	$(AS_ROOT) $(PYTHON) tests/chaos --minutes $(or $(MINUTES),3) --seed $(or $(SEED),1) \
	    $(if $(STRIKES),--strikes $(STRIKES)) $(if $(STANDING),--standing) $(if $(LEAPS),--leaps $(LEAPS))

mutants: setup notebooks ## Put bugs in, one at a time (ARGS="--room wire --near"): day's tests notice each
	PYTHONPATH=. $(PYTHON) tests/mutants/try_each.py $(value ARGS)

fuzz: setup ## Feed decoders and dispatcher INPUTS (10000000) spoiled messages, from SEED (1)
	$(PYTHON) tests/fuzz/feed.py --inputs $(or $(INPUTS),10000000) --seed $(or $(SEED),1)

commands: setup ## Run every command of the documentation, some an hour in all
	@$(call in_folder,$(AS_ROOT),tests/commands)

bench: setup ## Measure and print the speed of this machine
	bin/qmn lab bench

house: setup ## Count lines, files, options and more (REVISION=HEAD~20: of that one)
	@$(PYTHON) tests/house.py $(REVISION)

live-speed: setup browser ## Measure the live view: how far it is behind, its memory, what it costs
	$(AS_ROOT) PYTHONPATH=.:tests/unit/qmn:tests/unit/views $(PYTHON) tests/live_speed/measure.py

curves: setup ## Check the physics against theory and published figures, and draw it (curves/)
	bin/qmn lab curves

labs: setup ## Hold published results beside runs of the network (runs/labs/; ARGS=--resume goes on)
	bin/qmn lab published --all $(value ARGS)

pictures: setup ## Rebuild the pictures of reports and of the live page (docs/gallery/)
	@setup/browser
	@$(AS_ROOT) $(PYTHON) setup/pictures.py

recording: .venv/site ## Record docs/minute.cast again, which the site plays
	@setup/recording

lab-pictures: setup ## Rebuild the figures on the labs' pages
	@setup/lab-pictures

# The theme would advertise its successor.
site: .venv/site ## Build the documentation as web pages (site/index.html)
	@NO_MKDOCS_2_WARNING=1 $(PYTHON) -m mkdocs build --strict --quiet
	@echo 'site: site/index.html'

release: setup ## Build wheel, sdist and Debian package into dist/
	@setup/release/build

image: ## Build the Docker image
	@docker/build

clean: ## Remove what was built here (not runs/)
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache site $(GENERATED)
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

notebooks: .venv/notebooks ## Install what notebooks, data frames and Parquet need

.venv/notebooks: notebooks.lock | setup
	@echo 'setup: what notebooks and data frames need'
	@setup/python-packages notebooks.lock
	@touch $@

.venv/site: site.lock | setup
	@echo 'setup: what the site is built by'
	@setup/python-packages site.lock
	@touch $@

lock: ## Choose new versions of the Python packages
	@setup/lock

packages:
	@setup/packages apt-packages.txt

browser:
	@setup/browser

# Unchanged programs that tests run over q0, and those that `qmn rootless` needs.
q0-programs: | packages
	@setup/packages apt-packages-q0.txt

# Not where it would start as a service; there the tests that need it are skipped, and say so.
strongswan: | packages
	@[[ -d /run/systemd/system ]] || setup/packages apt-packages-strongswan.txt

.venv/complete: installer.lock requirements.lock ryu.lock build-constraints.txt | packages
	@setup/environment

%_pb2.py %_pb2.pyi %_pb2_grpc.py: %.proto .venv/complete
	@$(PYTHON) -m grpc_tools.protoc -I. --python_out=. --pyi_out=. --grpc_python_out=. $<
