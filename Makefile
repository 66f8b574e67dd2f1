# Each target sets up what it needs: Python 3.11 or newer, make, and a C and a C++ compiler are enough.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-builtin-rules
# The tests start Python some hundred times: it compiles the sources once, not every time.
unexport PYTHONDONTWRITEBYTECODE
# It compiles what is imported, which is less than half of what pip installs.
export PIP_COMPILE := 0

PYTHON ?= $(shell for name in python3 python3.13 python3.12 python3.11 python; do \
	if $$name -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then echo $$name; break; fi; done)
# The threads of OpenBLAS cost each start of Python with numpy some 0.2 s of processor time. Benchmarks keep them.
test pure compiled $(LANES) test-ros2 accept accept-robot accept-engine accept-tools accept-ros2: export OPENBLAS_NUM_THREADS := 1
CORES ?= $(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
# Many tests wait for processes and sockets.
TEST_PROCESSES = $(shell expr $(CORES) + 1)
PIP := -m pip --disable-pip-version-check
# The packages that an editable install is built with. With `--no-build-isolation`, pip does not install them, mypy
# and their dependencies a second time, into an environment of its own.
BUILD_TOOLS := 'setuptools>=78.1.1' 'setuptools-scm>=8.1'
COMPILER := 'mypy[mypyc]>=1.18' lxml-stubs types-setuptools
# $(PROGRESS) TITLE COMMAND... shows that a command of minutes is running.
PROGRESS := $(PYTHON) .ci/progress
ENGINE := $(shell find btcore tools trees -name '*.py' -o -name '*.xml') pyproject.toml setup.py README.md LICENSE
# The tests by package. Each test is in one lane.
LANE_core := tests/btcore tests/conformance tests/fuzz tests/properties tests/regressions/btcore
LANE_monitor := tests/monitor tests/regressions/monitor
LANE_robot := tests/robot_nodes
LANE_sim := tests/sim
LANE_tools := tests/tools
# The pages of the documentation, examples, benchmarks, packaging.
LANE_docs := tests/docs $(wildcard tests/test_*.py)
LANES := $(addprefix test-,core monitor robot sim tools docs)
# The tests of what is compiled, or of code that sees compiled classes. Of the tests of XML, those that load trees:
# the others execute hardly a compiled line that these do not.
COMPILED_TESTS := $(addprefix tests/btcore/,blackboard engine loading nodes registry script test_builds.py \
	test_status.py tree values xml/plan xml/read/test_element.py) tests/conformance tests/fuzz tests/properties \
	tests/regressions/btcore tests/tools/btcore_batch tests/docs/test_docstring_examples.py \
	$(addprefix tests/tools/btcore_recorder/,test_excerpts.py test_replay.py test_what_if.py)
# Tests that wait for other processes run first: meanwhile other tests use the cores, and the last tests do not wait.
WAITING := $(wildcard tests/test_*.py) tests/tools/
ALL_TESTS := $(WAITING) $(filter-out $(WAITING) tests/__pycache__/,$(wildcard tests/*/))
# On Windows, types can differ only in files that use modules of the standard library that are different there.
PLATFORM_MODULES := asyncio|ctypes|errno|faulthandler|fcntl|grp|http|locale|mmap|msvcrt|multiprocessing|os|pty|pwd
PLATFORM_MODULES := $(PLATFORM_MODULES)|readline|resource|select|selectors|shutil|signal|socket|socketserver|ssl|stat
PLATFORM_MODULES := $(PLATFORM_MODULES)|subprocess|sys|syslog|tempfile|termios|time|tty|urllib|webbrowser|zipfile
PYTHON_FOLDERS := btcore monitor robot_nodes ros2 sim tools packaging/studio_site tests/typing
# Continuous integration also checks the types on Windows, and runs the blocks of all pages.
WITHOUT_PAGES := --deselect tests/docs/test_docs.py::test_the_examples_of_a_page_run
BENCHMARKS := $(filter-out ros2,$(basename $(notdir $(wildcard benchmarks/*.py))))
ENGINE_BENCHMARKS := startup ticking features observers recording load editing growth publishing batch
# PyPI has wheels of ROS 2 for this platform only.
ROS2 := $(filter Linux-x86_64,$(shell uname -sm | tr ' ' -))
MESSAGES := $(shell find ros2/btcore_ros2/message_packages -type f -not -name '*.pyc')
# The page of the studio, whose sources are in TypeScript.
PAGE := tools/btcore_studio/page
PAGE_SOURCES := $(PAGE)/tsconfig.json $(wildcard $(PAGE)/*.html $(PAGE)/*.css $(PAGE)/src/* $(PAGE)/src/*/*)
# The page as a site of static files, with Python in Pyodide. The wheels are for the Python of Pyodide.
SITE := packaging/studio_site
SITE_PARTS := out/studio-site-parts
PYODIDE_TAGS := --python-version 3.14 --implementation cp --abi cp314 --platform pyemscripten_2026_0_wasm32
VULKAN := mesa-vulkan-drivers libvulkan1

NPM_OPTIONS := --loglevel=error --no-audit --no-fund --no-package-lock

# What the demo runs, and for how long (s of the robot's time).
DEMO := bumpgo_wide --world arena_boxes --seed 7 --duration 60

# Targets that `make test` makes beside the tests, which often wait.
BESIDE ?=

# The options of each acceptance run, whose script `--help` describes; `none` leaves the run out. Durations are in s.
BUMPGO ?= --seeds 200
PATROLLING ?= --seeds 10
FAILURES ?= --seeds 3
WORLDS ?= --worlds 30
SWEEP ?= --episodes 1000
LOWER_BOUNDS ?=
FUZZ ?= --inputs 100000
RECORDING ?= --duration 600
ATTACKS ?= --pairs 3 --seconds 10
STARVED ?= --starved 20 --seconds 3
MCP_ATTACKS ?=
MISTAKES ?=
STUDIO ?= --trials 9
STUDIO_SITE ?= --trials 5
PROOFS ?= --trees 1000
TYPED_FILES ?= --files 200
KILLS ?= --trials 100
CPP_RECORDINGS ?= none
ROS2_SCHEDULES ?= --schedules 500
ROS2_RUNS ?=
ROS2_GOALS ?= --goals 2000
# The acceptance runs that pytest makes: the number of random editing operations, and of recorded runs; or `none`.
EDITS ?= 10000
RECORDED_RUNS ?= 2000
# The number of recorded cases that Pyodide runs; or `none`. There are some 17,000.
SITE_CASES ?= 20000
# $(call acceptance,SCRIPT,OPTIONS[,FURTHER ARGUMENTS[,ENVIRONMENT]]) runs a script unless its options are `none`.
acceptance = @$(if $(filter none,$(2)),,$(or $(4),.venv)/bin/python tests/acceptance/$(1).py $(3) $(2))

.PHONY: help setup setup-core demo test $(LANES) test-ros2 check environments lint other-tests pure compiled vulkan accept \
	accept-robot accept-engine accept-tools accept-ros2 docs page studio-site vscode npm-checks dist bench clean

help:
	@echo 'make setup   .venv with all packages; make setup-core: only what work on the engine needs'
	@echo 'make demo    a simulated Tiago bumps and goes, seen in the monitor'
	@echo 'make test    style, types, and the tests on both builds of the engine'
	@echo '             CI=true as in CI: also types on Windows, all pages, full counts of random examples'
	@echo 'make test-core, test-monitor, test-robot, test-sim, test-tools, test-docs, test-ros2'
	@echo '             the tests of a package on the pure build; ROS 2 has an environment of its own'
	@echo 'make check   style, types and the closest tests of the changed files, or of FILES="…"'
	@echo 'make accept  the acceptance runs, on all cores; goes on where it was interrupted'
	@echo 'make docs    the documentation site, in out/docs/site'
	@echo 'make page    the page of btcore studio; with npm, or with Node from PyPI'
	@echo 'make studio-site  the studio as static files, in out/studio-site; with npm, or with Node from PyPI'
	@echo 'make vscode  the extension for VS Code, out/btcore.vsix; needs npm'
	@echo 'make dist    the files of a release for this machine, in dist'
	@echo 'make lint    style and types only'
	@echo 'make bench   the benchmarks on both builds, in ratios beside their targets'
	@echo 'make clean   everything that the other targets made'

# --- set-up

setup: .venv/ready

# What work on the engine needs. `make setup` adds the rest to the same environment.
setup-core: .venv/core

.venv/core: pyproject.toml setup.py
	@$(PYTHON) -m venv .venv
	@$(PROGRESS) 'setting up .venv with $(PYTHON), for work on the engine' \
		.venv/bin/python $(PIP) install --editable '.[dev-core]'
	@touch $@

# The project without its dependencies. pip builds it in folders of the checkout, one environment after the other.
.venv/project: pyproject.toml setup.py
	@test -n '$(PYTHON)' || { echo 'btcore needs Python 3.11 or newer; none is on the PATH.' \
		'PYTHON=/path/to/python3 make … names one.' >&2; exit 1; }
	@$(PYTHON) -m venv .venv
	@.venv/bin/python $(PIP) install --quiet $(BUILD_TOOLS)
	@.venv/bin/python $(PIP) install --quiet --no-build-isolation --no-deps --editable .
	@touch $@

.venv/ready: .venv/project
	@$(PROGRESS) 'setting up .venv with $(PYTHON), everything included' \
		.venv/bin/python $(PIP) install 'btcore[dev]'
	@touch $@

.venv-compiled/ready: $(ENGINE) .venv/project
	@rm -rf build out/wheel
	@test -x .venv-compiled/bin/python || $(PYTHON) -m venv .venv-compiled
	@.venv-compiled/bin/python $(PIP) install --quiet $(BUILD_TOOLS) $(COMPILER)
	@BTCORE_COMPILED=1 $(PROGRESS) 'building the wheel of the compiled engine' \
		.venv-compiled/bin/python $(PIP) wheel --verbose --no-build-isolation --no-deps --wheel-dir out/wheel .
	@.venv-compiled/bin/python $(PIP) install --quiet --force-reinstall --no-deps out/wheel/btcore-*.whl
	@$(PROGRESS) 'installing the compiled engine into .venv-compiled' \
		.venv-compiled/bin/python $(PIP) install "$$(echo out/wheel/btcore-*.whl)[batch,record,testing]" pytest-xdist
	@touch $@

.venv-compiled/bench: .venv-compiled/ready
	@$(PROGRESS) 'installing what the benchmarks need' \
		.venv-compiled/bin/python $(PIP) install "$$(echo out/wheel/btcore-*.whl)[bench]"
	@touch $@

# The tests use the monitor's client, but not its viewer, which is a quarter of .venv. ROS 2's generators take a third
# less time with empy 3.
FOR_ROS2_TESTS := 'empy<4' msgpack pytest-xdist pyzmq ros-test-msgs==2.3.0

# Compiling all bundled messages takes two thirds longer. Messages that these contain are built, too.
FOR_ROS2_TESTS_BUILT := TFMessage ExecuteTree GetTrees BehaviorTreeLog ParticleCloud CostmapUpdate \
	OccupancyGridUpdate AssistedTeleop BackUp ComputePathThroughPoses ComputePathToPose DriveOnHeading FollowPath \
	FollowWaypoints NavigateThroughPoses NavigateToPose SmoothPath Spin Wait ClearCostmapAroundRobot \
	ClearCostmapExceptRegion ClearEntireCostmap GetCostmap GetCosts IsPathValid LoadMap ManageLifecycleNodes

# An environment of its own, because ROS 2's wheels restart each Python that starts in their environment.
.venv-ros/ready: pyproject.toml setup.py $(MESSAGES) | .venv/project
	@$(PYTHON) -m venv .venv-ros
	@.venv-ros/bin/python $(PIP) install --quiet $(BUILD_TOOLS)
	@$(PROGRESS) 'setting up .venv-ros with ROS 2' \
		.venv-ros/bin/python $(PIP) install --no-build-isolation \
		--editable '.[bags,ros2,sim,testing]' $(FOR_ROS2_TESTS)
	@$(PROGRESS) 'building message packages of ROS 2' \
		.venv-ros/bin/btcore ros2 messages $(addprefix --only ,$(FOR_ROS2_TESTS_BUILT))
	@touch $@

.venv-release/ready:
	@$(PYTHON) -m venv .venv-release
	@.venv-release/bin/python $(PIP) install --quiet build twine
	@touch $@

# Software Vulkan draws the monitor's pictures where there is no graphics card.
vulkan:
	@if ls /usr/share/vulkan/icd.d/*.json >/dev/null 2>&1; then :; \
	elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		echo '· installing $(VULKAN)'; \
		export DEBIAN_FRONTEND=noninteractive; \
		apt-get install -qq -y $(VULKAN) >/dev/null 2>&1 \
			|| { apt-get update -qq && apt-get install -qq -y $(VULKAN) >/dev/null; } \
			|| echo 'note: that failed; picture tests are skipped'; \
	else echo 'note: without the packages $(VULKAN), picture tests are skipped'; fi

# --- what people ask for

demo: .venv/ready vulkan
	@mkdir -p out
	@if [ -n "$${DISPLAY:-}$${WAYLAND_DISPLAY:-}" ]; then \
		.venv/bin/btcore run $(DEMO) --monitor --save out/bumpgo.rrd; \
	else \
		rm -f out/bumpgo.rrd out/bumpgo.png; \
		.venv/bin/btcore run $(DEMO) --fast --save out/bumpgo.rrd --screenshot out/bumpgo.png || { \
			code=$$?; echo 'The demo is incomplete: see the error above.' >&2; exit $$code; }; \
		echo; \
		echo 'No display here, so the viewer stayed closed.'; \
		echo '  the recording  out/bumpgo.rrd   (.venv/bin/rerun out/bumpgo.rrd opens it)'; \
		echo '  the picture    out/bumpgo.png'; \
	fi

test:
	@$(MAKE) -s -j 4 lint pure other-tests

check: .venv/ready
	@.venv/bin/python tests/check.py $(if $(LIMIT),--limit $(LIMIT)) $(FILES)

environments: .venv/project
	@$(MAKE) -s .venv-compiled/ready
	$(if $(ROS2),@$(MAKE) -s .venv-ros/ready)

# The environments are built beside the other tests.
other-tests: .venv/ready environments
	@$(MAKE) -s --output-sync compiled test-ros2 $(BESIDE)

lint: .venv/ready
	@echo '· style and types'
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/mypy
	@$(if $(CI),.venv/bin/mypy --platform win32 --cache-dir .mypy_cache/win32 --follow-imports silent \
		$$(grep -rlE '^ *(import|from) ($(PLATFORM_MODULES))\b' --include='*.py' $(PYTHON_FOLDERS)))

# Continuous integration tests the page, too.
pure: .venv/ready vulkan $(if $(CI),page)
	@echo '· the tests, on the pure build$(if $(CI),, (the pages of the documentation: make test-docs))'
	@# In a new checkout, each process would compile all tests, at the same time.
	@test -d tests/__pycache__ || .venv/bin/pytest -q --collect-only >/dev/null || true
	@BTCORE_EXPECT=pure .venv/bin/pytest -n $(TEST_PROCESSES) --dist worksteal $(ALL_TESTS) \
		$(if $(CI),,$(WITHOUT_PAGES))

$(LANES): .venv/ready vulkan
	@BTCORE_EXPECT=pure .venv/bin/pytest -n $(TEST_PROCESSES) --dist worksteal $(LANE_$(@:test-%=%))

compiled: .venv-compiled/ready
	@echo '· the tests of the engine, on the compiled build'
	@BTCORE_EXPECT=compiled .venv-compiled/bin/pytest -n $(CORES) --dist worksteal $(COMPILED_TESTS)

# All tests of a file in one process: they share the processes that they start. What fails runs again in new
# processes, because Fast DDS 3.2 may deadlock when a ROS node ends; see tests/ros2/conftest.py.
ROS2_TESTS = BTCORE_EXPECT=pure .venv-ros/bin/pytest -n $(TEST_PROCESSES) --dist loadfile \
	--no-loadscope-reorder -o cache_dir=.pytest_cache/ros2 tests/ros2

ifneq ($(ROS2),)
test-ros2: .venv-ros/ready
	@echo '· the tests of ROS 2'
	@$(ROS2_TESTS) || $(ROS2_TESTS) --last-failed --last-failed-no-failures none
else
test-ros2:
	@echo 'note: PyPI has no wheels of ROS 2 for this platform; its tests are skipped'
endif

accept: accept-engine accept-tools accept-robot $(if $(ROS2),accept-ros2,test-ros2)

accept-robot: .venv/ready
	$(call acceptance,bumpgo,$(BUMPGO),--jobs $(CORES))
	$(call acceptance,patrolling,$(PATROLLING),--jobs $(CORES))
	$(call acceptance,failures,$(FAILURES),--jobs $(CORES))
	$(call acceptance,worlds,$(WORLDS),--jobs $(CORES))
	$(call acceptance,sweep,$(SWEEP),--jobs $(CORES))

accept-engine: .venv/ready .venv-compiled/ready
	@.venv/bin/python tests/acceptance/installs.py out/wheel/btcore-*.whl
	$(call acceptance,lower_bounds,$(LOWER_BOUNDS),out/wheel/btcore-*.whl)
	$(call acceptance,fuzz,$(FUZZ),--jobs $(CORES))
	$(call acceptance,recording,$(RECORDING))
	$(call acceptance,attacks,$(ATTACKS))
	$(call acceptance,attacks,$(STARVED))

accept-tools: .venv/ready page $(if $(filter none,$(STUDIO_SITE)),,studio-site)
	@$(if $(filter none,$(EDITS)),,BTCORE_EXPECT=pure BTCORE_EDITS=$(EDITS) .venv/bin/pytest -n $(CORES) \
		--dist worksteal tests/tools/btcore_studio/edit tests/tools/btcore_studio/language/test_edit_commands.py \
		tests/tools/btcore_studio/page/test_editing.py)
	@$(if $(filter none,$(RECORDED_RUNS)),,BTCORE_EXPECT=pure BTCORE_RUNS=$(RECORDED_RUNS) .venv/bin/pytest -n $(CORES) \
		$(addprefix tests/tools/btcore_recorder/,test_excerpts.py test_replay.py test_what_if.py test_why.py))
	@$(if $(filter none,$(SITE_CASES)),,BTCORE_SITE_CASES=$(SITE_CASES) .ci/studio-site)
	$(call acceptance,mcp_attacks,$(MCP_ATTACKS))
	$(call acceptance,mistakes,$(MISTAKES))
	$(call acceptance,studio,$(STUDIO))
	$(call acceptance,studio_site,$(STUDIO_SITE))
	$(call acceptance,proofs,$(PROOFS),--jobs $(CORES))
	$(call acceptance,typed_files,$(TYPED_FILES),--jobs $(CORES))
	$(call acceptance,kills,$(KILLS))
	$(call acceptance,cpp_recordings,$(CPP_RECORDINGS))

accept-ros2: .venv-ros/ready
	$(call acceptance,ros2_schedules,$(ROS2_SCHEDULES),,.venv-ros)
	$(call acceptance,ros2_runs,$(ROS2_RUNS),,.venv-ros)
	$(call acceptance,ros2_goals,$(ROS2_GOALS),,.venv-ros)

# Nothing of this is committed: npm brings the tools, in the versions of package.json.
page: $(PAGE)/built/index.html

$(PAGE)/built/index.html: $(PAGE)/node_modules/ready $(PAGE_SOURCES)
	@echo '· building the page of the studio'
	@cd $(PAGE) && rm -rf built && $(CURDIR)/.ci/npm run --silent build -- --log-level=warning
	@touch $@

$(PAGE)/node_modules/ready: $(PAGE)/package.json
	@cd $(PAGE) && PYTHON='$(PYTHON)' $(CURDIR)/.ci/npm install $(NPM_OPTIONS)
	@touch $@

studio-site: out/studio-site/index.html

out/studio-site/index.html: $(PAGE)/built/index.html $(SITE)/node_modules/ready $(SITE_PARTS)/ready $(ENGINE) \
		$(wildcard $(SITE)/*.*) .venv/ready
	@echo '· building the studio as a site of static files'
	@rm -f $(SITE_PARTS)/btcore-*.whl
	@BTCORE_PURE=1 .venv/bin/python $(PIP) wheel --quiet --no-build-isolation --no-deps --wheel-dir $(SITE_PARTS) .
	@.ci/npm --prefix $(PAGE) run --silent build-worker -- --log-level=warning --outfile=$(CURDIR)/$(SITE_PARTS)/worker.js
	@.venv/bin/python $(SITE)/build_site.py $(SITE_PARTS) $(@D)

$(SITE)/node_modules/ready: $(SITE)/package.json
	@cd $(SITE) && PYTHON='$(PYTHON)' $(CURDIR)/.ci/npm install $(NPM_OPTIONS)
	@touch $@

$(SITE_PARTS)/ready: $(SITE)/requirements.txt | .venv/project
	@rm -rf $(@D) && mkdir -p $(@D)
	@.venv/bin/python $(PIP) download --quiet --require-hashes --no-deps --only-binary=:all: $(PYODIDE_TAGS) \
		--dest $(@D) --requirement $<
	@touch $@

# The extension contains the page.
vscode: page
	@mkdir -p out
	@cp LICENSE editors/vscode/LICENSE
	@mkdir -p editors/vscode/out/page
	@cp $(PAGE)/built/studio.{js,css} editors/vscode/out/page
	@cd editors/vscode && npm install $(NPM_OPTIONS) && npm run --silent package

# All but .ci/page are skipped if npm cannot bring their tools; the page is needed by tests anyway.
npm-checks: .venv/ready
	@.ci/pyright
	@.ci/workflows
	@MAKEFLAGS= .ci/vscode
	@MAKEFLAGS= .ci/page
	@MAKEFLAGS= .ci/studio-site

docs: .venv/ready
	@$(PROGRESS) 'building the documentation site' .venv/bin/python -u docs/site/build_site.py
	@echo '  out/docs/site/index.html'

# Both wheels are built from the sdist, which proves that the sdist is complete.
dist: .venv-release/ready page
	@rm -rf dist
	@echo '· building the sdist and the pure wheel'
	@BTCORE_PURE=1 .venv-release/bin/python -m build --quiet
	@echo '· building the compiled wheel'
	@BTCORE_COMPILED=1 .venv-release/bin/python $(PIP) wheel --quiet --no-deps --wheel-dir dist dist/btcore-*.tar.gz
	@.venv-release/bin/twine check --strict dist/*
	@echo '· writing the software bill of materials'
	@mkdir -p out
	@.venv-release/bin/python packaging/sbom.py dist/btcore-*-none-any.whl out/btcore.cdx.json
	@$(if $(ROS2),$(MAKE) -s dist/messages)

# The wheels of message packages, built by the pure wheel in an environment of its own.
.PHONY: dist/messages
dist/messages:
	@test -x .venv-messages/bin/python || $(PYTHON) -m venv .venv-messages
	@.venv-messages/bin/python $(PIP) install --quiet --force-reinstall --no-deps dist/btcore-*-none-any.whl
	@$(PROGRESS) 'installing ROS 2 into .venv-messages' \
		.venv-messages/bin/python $(PIP) install "$$(echo dist/btcore-*-none-any.whl)[ros2]"
	@$(PROGRESS) 'building the wheels of message packages' \
		.venv-messages/bin/btcore ros2 messages --force --wheels $@

bench: .venv/ready .venv-compiled/bench $(if $(ROS2),.venv-ros/ready)
	@rm -rf out/bench && mkdir -p out/bench
	@echo '· every benchmark, on the pure build'
	@for name in $(BENCHMARKS); do .venv/bin/python benchmarks/$$name.py --json out/bench/pure-$$name.json \
		|| echo "note: $$name was not measured"; done
	@echo '· the benchmarks of the engine, on the compiled build'
	@for name in $(ENGINE_BENCHMARKS); do \
		.venv-compiled/bin/python benchmarks/$$name.py --json out/bench/compiled-$$name.json; done
	@.venv/bin/python benchmarks/measure/plot.py out/performance.png out/bench/*.json
	@$(if $(ROS2),.venv-ros/bin/python benchmarks/ros2.py)

clean:
	rm -rf .venv .venv-compiled .venv-messages .venv-ros .venv-release build dist out .venv-node $(PAGE)/node_modules $(PAGE)/built $(SITE)/node_modules editors/vscode/node_modules editors/vscode/out .accept ./*.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
