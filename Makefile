# make demo    set up, then every step in ./demo: print files, 144 images, table and report
# make test    set up, then the quick tests, one process for each core; PYTEST_ARGS="tests/rig -x" for some
# make test-all  and those that take long: trainings, whole roads, kills and resumptions; CI runs this
# make fuzz    attack every reader and command with bad input, others each time: some minutes; FUZZ=1000 for hours
# make validate  pages, meshes, PDFs and the package before validators that others wrote, and glTFs beside three.js
# make bench   speed against the peers, as ratios in one run
# make lint    ruff, mypy, and import-linter: imports point down, no circles
# make versions  note the versions that the tests ran with in scripts/tested-versions.txt; to have the same:
#              pip install -c scripts/tested-versions.txt -e .
# make test-versions  the quick tests on every Python from 3.10 to 3.14 that is installed here
# make test-lowest  the tests with the lowest versions that pyproject.toml allows, in .venv-lowest; Python 3.10
# make reference  write what the pages take from the code: commands, fields of files, names, packages
# make site    the documentation as a site in ./site; it opens from disk
# make docs    measure the results anew and draw the figures: about two hours
# TORCH=cpu    with any of these, in a new checkout: a PyTorch without CUDA's libraries
# UV=          pip installs the packages even if uv is on the path

# Older ones than 3.13 first: Open3D draws without Vulkan there.
PYTHON ?= $(firstword $(foreach v,3.12 3.11 3.10 3.13 3.14,$(if $(shell python$(v) -c 'import venv, ensurepip' 2>/dev/null && echo yes),python$(v))) python3)
BIN := .venv/bin
UV ?= $(shell command -v uv 2>/dev/null)
TORCH ?=
export UV TORCH
# $(call install,FOLDER) and what to install into that environment
install = $(if $(UV),"$(UV)" pip install --quiet --python $(1)/bin/python,$(1)/bin/python -m pip install --quiet --progress-bar off)
# Weights that lie beside the checkout are used where there are any.
export TOOLKIT_WEIGHTS ?= $(abspath $(wildcard ../shared/weights))

.PHONY: demo test test-all test-lowest test-versions versions fuzz validate bench lint docs docs-benchmark docs-training reference site setup clean

demo: setup
	$(BIN)/toolkit demo demo

# TEST_RAY=1 runs the tests of the Ray engine as well, which listens on all interfaces while they run.
test: setup .venv/.test
	@scripts/test-browser
	$(BIN)/python -m pytest -n logical --maxprocesses 8 --dist worksteal -m "not slow" $(PYTEST_ARGS)

test-all: setup .venv/.test
	@scripts/test-browser
	$(BIN)/python -m pytest -n logical --maxprocesses 8 --dist worksteal $(PYTEST_ARGS)

FUZZ ?= 200
fuzz: setup .venv/.test
	FUZZ=$(FUZZ) $(BIN)/python -m pytest tests/hostile -n logical --maxprocesses 8 --dist worksteal $(PYTEST_ARGS)

validate: setup .venv/.test .venv/.validate
	$(BIN)/python scripts/validate $(BIN)

bench: setup .venv/.bench
	$(BIN)/python -m benchmarks

lint: setup .venv/.lint
	$(BIN)/ruff format --check . && $(BIN)/ruff check . && $(BIN)/lint-imports && $(BIN)/mypy

# Networks that judge the shipped captures; DOCS_MODELS="timm:tf_efficientnet_lite0 ..." adds more.
DOCS_MODELS ?=
docs: setup .venv/.test
	docs/scripts/run-results $(BIN)/toolkit $(DOCS_MODELS)
	docs/scripts/run-transfer $(BIN)/toolkit $(DOCS_MODELS)

# The corruption benchmark's numbers; four hours on two cores. PHOTOGRAPHS has a folder per WordNet id, CIFAR has
# train/ and test/ with a folder per class.
PHOTOGRAPHS ?= ../shared/images/nips2017
CIFAR ?= cifar10
docs-benchmark: setup
	docs/scripts/run-benchmark $(BIN)/toolkit "$(PHOTOGRAPHS)" "$(CIFAR)"
	docs/scripts/run-ablation $(BIN)/toolkit "$(PHOTOGRAPHS)"

# What each part of a patch's training is worth, small sheets, and objects that are not of the kit; four hours.
MESHES ?= ../shared/meshes
CITY ?= ../shared/worlds/kaykit-city
docs-training: setup
	docs/scripts/run-parts $(BIN)/toolkit
	docs/scripts/run-objects $(BIN)/toolkit "$(MESHES)" "$(CITY)"

versions: setup .venv/.test
	$(BIN)/python scripts/versions tested > scripts/tested-versions.txt

test-lowest: setup .venv/.test
	TORCH= scripts/make-venv "$(PYTHON)" .venv-lowest
	$(BIN)/python scripts/versions lowest > .venv-lowest/versions.txt
	$(call install,.venv-lowest) -c .venv-lowest/versions.txt -e ".[test]"
	.venv-lowest/bin/python -m pytest -n logical --maxprocesses 8 --dist worksteal -m "not slow" $(PYTEST_ARGS)

test-versions:
	@scripts/system-libraries
	@scripts/test-versions $(PYTEST_ARGS)

reference: setup
	$(BIN)/python docs/scripts/reference.py

site: setup .venv/.site
	$(BIN)/mkdocs build --strict --quiet

setup: .venv/.installed
	@scripts/system-libraries

.venv/.installed: pyproject.toml scripts/make-venv
	scripts/make-venv "$(PYTHON)" .venv
	$(call install,.venv) -e .
	$(BIN)/python -c "from toolkit.rig.raycast import compile_ahead; compile_ahead()"
	touch $@

.venv-3.%/.test: pyproject.toml scripts/make-venv
	scripts/make-venv "$(PYTHON)" .venv-3.$*
	$(call install,.venv-3.$*) -e ".[test]"
	touch $@

.venv/.test .venv/.lint .venv/.bench .venv/.site .venv/.validate: .venv/.%: .venv/.installed pyproject.toml
	$(call install,.venv) -e ".[$*]"
	touch $@

clean:
	rm -rf .venv .venv-lowest .venv-3.* demo site
