# One line each; the logic is in Python. `make help` lists the targets.
PY := .venv/bin/python
DATA ?= data/prepared
OUT ?= data/prepared
PRESET ?= small
PROTOCOL ?= fewshot-10
LIST ?=
WORKERS ?= 2
BODY ?=
DATASET ?=
SEQUENCES ?=
MASKS ?=
DEMO ?= data/demo
SOURCE ?=

.PHONY: help setup prepare inspect pretrain fewshot evaluate render bake stability report tables demo test test-all check format lint types wheel bench clean

help:  ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

setup:  ## virtual environment, packages, LPIPS weights, headless OpenGL (safe to repeat)
	@python3 scripts/setup.py

inspect: setup  ## say what a download holds and what is wrong with it: SOURCE= [BODY= SEQUENCES=]
	@$(PY) -m actorsnerf_preprocess inspect --source "$(SOURCE)" $(if $(BODY),--body-model "$(BODY)") $(if $(SEQUENCES),--sequences $(SEQUENCES))

prepare: setup  ## raw download to HDF5: SOURCE= [DATASET=zju-mocap|aist|synthetic OUT= BODY= SEQUENCES= MASKS= WORKERS=]
	@$(PY) -m actorsnerf_preprocess prepare --source "$(or $(SOURCE),data/raw)" --out "$(OUT)" --workers $(WORKERS) $(if $(DATASET),--dataset $(DATASET)) $(if $(BODY),--body-model "$(BODY)") $(if $(SEQUENCES),--sequences $(SEQUENCES)) $(if $(MASKS),--masks "$(MASKS)")

pretrain: setup  ## category-level training: RUN= [DATA= PRESET=]
	@$(PY) -m actorsnerf_train pretrain --data "$(DATA)" --run "$(RUN)" --preset $(PRESET)

fewshot: setup  ## fit a new actor: DATA=FILE FROM=RUN RUN= [PROTOCOL= LIST=official|auto]
	@$(PY) -m actorsnerf_train fewshot --data "$(DATA)" --from "$(FROM)" --run "$(RUN)" --protocol $(PROTOCOL) $(if $(LIST),--list $(LIST))

evaluate: setup  ## unseen poses and views: RUN= DATA=FILE
	@$(PY) -m actorsnerf_train evaluate --checkpoint "$(RUN)" --data "$(DATA)" --out "$(RUN)/evaluation"

render: setup  ## a turntable of a fitted actor: RUN=
	@$(PY) -m actorsnerf_train render --checkpoint "$(RUN)" --out "$(RUN)/turntable"

bake: setup  ## a fitted actor as one small file for fast rendering: RUN= [VOXEL=metres]
	@$(PY) -m actorsnerf_train bake --checkpoint "$(RUN)" --out "$(RUN)/actor.safetensors" $(if $(VOXEL),--voxel $(VOXEL))

stability: setup  ## hard cases on a checkpoint, or on an invented actor: [RUN= STABILITY=]
	@$(PY) -m actorsnerf_train stability $(if $(RUN),--run "$(RUN)") --out "$(or $(STABILITY),data/stability)"

report: setup  ## speed against error of the operating points: CHECKPOINT= DATA=FILE [REPORT=]
	@$(PY) -m actorsnerf_train report $(CHECKPOINT) --data $(DATA) --out "$(or $(REPORT),data/report)"

tables: setup  ## the paper's tables: plan, train what is missing, write: DATA= [TABLES= PRESET=]
	@$(PY) -m actorsnerf_train tables --data $(DATA) --out "$(or $(TABLES),data/tables)" --preset $(PRESET)

demo: setup  ## everything, on synthetic actors (or SOURCE=): pictures in data/demo
	@$(PY) scripts/demo.py --out "$(DEMO)" $(if $(SOURCE),--source "$(SOURCE)") $(if $(BODY),--body-model "$(BODY)")

test: setup  ## all tests but the slow ones
	@$(PY) -m pytest -q -m "not slow and not gpu"

test-all: setup  ## all tests
	@$(PY) -m pytest -q -m "not gpu"

check: setup lint types wheel  ## lint, types, import direction, wheel

lint:
	@$(PY) -m ruff check . && $(PY) -m ruff format --check . && .venv/bin/lint-imports --no-cache

types:
	@$(PY) -m mypy

wheel:
	@$(PY) -m pip wheel --quiet --no-deps --wheel-dir build/wheel . && $(PY) scripts/check_wheel.py build/wheel

format: setup  ## format the code
	@$(PY) -m ruff format . && $(PY) -m ruff check --fix .

bench: setup  ## measure; writes benchmarks/results
	@$(PY) benchmarks/run.py

clean:  ## caches and builds, not data or runs
	@rm -rf build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
