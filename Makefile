# The two commands that matter are `make study` and `make test`; both install first.
#   make study PYTHON=python3.12   another interpreter to build the environment with
#   make test VENV=/path/to/venv   another place for the environment

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
STUDY := results/study
WORKERS ?= logical
CONCEALED := $(VENV)/concealed
BASE ?= HEAD~1
CASES ?= quick

# Idle threads of torch sleep instead of spinning: on two cores that is 20 times faster.
export OMP_WAIT_POLICY := PASSIVE
# Memory that was freed stays with the process: of glibc, a thirtieth of the time.
export MALLOC_MMAP_THRESHOLD_ := 33554432
export MALLOC_TRIM_THRESHOLD_ := 1000000000
export MALLOC_TOP_PAD_ := 64000000

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install study diagnosis test golden lint format view clean

help:
	@echo 'make study    install, run the study at the quick budget, say where it is'
	@echo 'make test     install, run all tests'
	@echo 'make golden   compare with an older commit to the last digit: BASE=HEAD~1, a minute;'
	@echo '              CASES=all: every case, ten minutes'
	@echo 'make install  install into .venv and nothing else'
	@echo 'make view     open the recording of the study'
	@echo 'make diagnosis conceal two effects, then all that an arm has, find them,'
	@echo '              write results/diagnosis'
	@echo 'make lint     style, layout, types'
	@echo 'make format   mend style and layout'
	@echo 'make clean    remove the environment and caches; results stay'

install: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo 'Python 3.11 or newer is needed, "$(PYTHON)" is not; name another:' >&2; \
		echo '    make $(or $(MAKECMDGOALS),install) PYTHON=python3.12' >&2; exit 1; }
	@test -x '$(BIN)/python' || $(PYTHON) -m venv '$(VENV)' || { \
		echo 'The environment could not be made. On Debian or Ubuntu:' >&2; \
		echo '    sudo apt-get install python3-venv' >&2; exit 1; }
	@echo 'Installing into $(VENV), some minutes the first time.'
	@'$(BIN)/python' -m pip install --quiet --quiet \
		--constraint constraints.txt --editable '.[test,lint]'
	@touch '$@'

study: $(STAMP)
	'$(BIN)/python' -m scenarios.study --budget quick --seed 0 --out $(STUDY)
	@echo
	@echo 'Report:     $(STUDY)/report.html (and report.md)'
	@echo 'Recording:  $(STUDY)/study.rrd, opened by: make view'

diagnosis: $(STAMP)
	@rm -rf '$(CONCEALED)' '$(CONCEALED)-whole-arm'
	'$(BIN)/python' -m scenarios.record --effect hysteresis@a2,width_rad=1.2e-4 \
		--effect bearing_tilt@a3 --out '$(CONCEALED)'
	'$(BIN)/python' -m scenarios.diagnose '$(CONCEALED)' \
		--robot mjcf/kr10_r1100_2/kr10_r1100_2.xml --out results/diagnosis
	'$(BIN)/python' -m scenarios.record --truth default --out '$(CONCEALED)-whole-arm'
	'$(BIN)/python' -m scenarios.diagnose '$(CONCEALED)-whole-arm' \
		--robot mjcf/kr10_r1100_2/kr10_r1100_2.xml --out results/diagnosis/whole_arm

test: $(STAMP)
	'$(BIN)/python' -m pytest -q --numprocesses $(WORKERS) --maxprocesses 4 --dist loadfile \
		--no-loadscope-reorder

golden: $(STAMP)
	'$(BIN)/python' tests/golden --base '$(BASE)' --cases '$(CASES)'

lint: $(STAMP)
	'$(BIN)/ruff' check .
	'$(BIN)/ruff' format --check .
	'$(BIN)/pyright' --pythonpath '$(BIN)/python'

format: $(STAMP)
	'$(BIN)/ruff' check --fix .
	'$(BIN)/ruff' format .

view: $(STAMP)
	@test -f $(STUDY)/study.rrd || { echo 'No recording yet: make study' >&2; exit 2; }
	@test "$$(uname)" != Linux || test -n "$$DISPLAY$$WAYLAND_DISPLAY$$WAYLAND_SOCKET" || { \
		echo 'There is no display here. Copy $(STUDY)/study.rrd to a computer with one;' >&2; \
		echo "there: pip install $$(grep ^rerun-sdk== constraints.txt)" >&2; \
		echo '       rerun study.rrd' >&2; exit 2; }
	'$(BIN)/rerun' $(STUDY)/study.rrd

clean:
	rm -rf '$(VENV)' .pytest_cache .ruff_cache .hypothesis build dist MUJOCO_LOG.TXT
	find bench stiffness scenarios tests -name __pycache__ -type d -prune -exec rm -rf {} +
