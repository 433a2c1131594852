# make demo    set up, then the whole road in ./demo: print files, 144 images, table and report
# make test    set up, then all tests
# make bench   speed against the peers, as ratios in one run
# make lint    ruff, mypy, and import-linter: imports point down, no circles
# make docs    draw the figures of README and docs again

PYTHON ?= $(firstword $(foreach v,3.12 3.11 3.10,$(if $(shell python$(v) -c 'import venv, ensurepip' 2>/dev/null && echo yes),python$(v))) python3)
BIN := .venv/bin
# Weights that lie beside the checkout are used where there are any.
export TOOLKIT_WEIGHTS ?= $(abspath $(wildcard ../shared/weights))

.PHONY: demo test bench lint docs docs-benchmark setup clean

demo: setup
	$(BIN)/toolkit demo demo

test: setup .venv/.test
	@scripts/test-browser
	$(BIN)/python -m pytest $(PYTEST_ARGS)

bench: setup .venv/.bench
	$(BIN)/python -m benchmarks

lint: setup .venv/.lint
	$(BIN)/ruff format --check . && $(BIN)/ruff check . && $(BIN)/lint-imports && $(BIN)/mypy

# Networks that judge the shipped captures; DOCS_MODELS="timm:tf_efficientnet_lite0 ..." adds more.
DOCS_MODELS ?=
CONTROLS := $(addprefix --variant ,wrong-patch random-patch grey-patch patch-alone)
docs: setup .venv/.test
	$(BIN)/toolkit demo demo
	$(BIN)/toolkit plan --workspace demo --object coffeepot --shot-list
	$(BIN)/toolkit capture-sim --workspace demo $(CONTROLS)
	for model in resnet18 mobilenet_v2 $(DOCS_MODELS); do \
		$(BIN)/toolkit eval demo/captures --workspace demo --source sim --model $$model || exit 1; done
	mkdir -p demo/print/patches && cp -r print/patches/both demo/print/patches/
	$(BIN)/toolkit capture-sim --workspace demo --patches both --object coffeepot --object racer
	for model in resnet18 mobilenet_v2 $(DOCS_MODELS); do \
		$(BIN)/toolkit eval demo/captures --workspace demo --source sim-both --model $$model --run both-$${model##*:} \
		|| exit 1; done
	$(BIN)/toolkit capture-sim --workspace demo --source sim-textures --variant unpatched --variant patched \
		--variant textured --variant grey-texture --variant random-texture
	$(BIN)/toolkit corrupt demo/captures/sim-textures demo/captures/sim-textures-fog --name fog --severity 3
	for model in resnet18 mobilenet_v2 $(DOCS_MODELS); do \
		$(BIN)/toolkit eval demo/captures --workspace demo --source sim-textures --source sim-textures-fog \
		--model $$model --run textures-$${model##*:} || exit 1; done
	$(BIN)/toolkit print --workspace demo --board --ink 100
	$(BIN)/toolkit capture-sim --workspace demo --board --source sim-board-black
	$(BIN)/toolkit print --workspace demo --board
	$(BIN)/toolkit capture-sim --workspace demo --board
	$(BIN)/toolkit eval demo/captures --workspace demo --source sim-board --source sim-board-black --run board-resnet18
	for axis in light backdrop distance resolution size; do \
		$(BIN)/toolkit sweep $$axis --workspace demo || exit 1; done
	$(BIN)/toolkit sweep distance --values 1,2,2.5,3 --workspace demo --model rig18 --patches rig18
	$(BIN)/python docs/make.py demo

# The corruption benchmark's numbers; an hour or two on two cores. PHOTOGRAPHS has a folder per WordNet id, CIFAR has
# train/ and test/ with a folder per class.
PHOTOGRAPHS ?= ../shared/images/nips2017
CIFAR ?= cifar10
docs-benchmark: setup
	docs/run-benchmark $(BIN)/toolkit "$(PHOTOGRAPHS)" "$(CIFAR)"

setup: .venv/.installed
	@scripts/system-libraries

.venv/.installed: pyproject.toml scripts/make-venv
	scripts/make-venv "$(PYTHON)"
	$(BIN)/python -m pip install --quiet --progress-bar off -e .
	touch $@

.venv/.test .venv/.lint .venv/.bench: .venv/.%: .venv/.installed pyproject.toml
	$(BIN)/python -m pip install --quiet -e ".[$*]"
	touch $@

clean:
	rm -rf .venv demo
