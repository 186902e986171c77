# make demo     watch a live ROS 2 node estimate velocity beside the truth (installs what it needs first)
# make test     every test but the slow ones, the multi-process ones over real DDS included (installs the rest)
# make test-fast  a minute: the tests without DDS, without a browser and without those that take long
# make test-slow  the tests that take minutes, and cases that repeat at length what others hold
# make test-export  headers of `export` with gcc, clang and g++, and on other machines where qemu is
# make figures  write the numbers that commands give into README and docs (docs/tools/figures.yaml)
# make bench    speed and accuracy next to named peers, in one run (BENCH="--part live": a part)
# make install  only make .venv with the package, ROS 2 Jazzy and all extras
# make check    ruff and mypy alone
# make clean    remove .venv and what builds leave behind

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := $(VENV)/.demo
ALL := $(VENV)/.all
SOURCES := setup.py setup.cfg pyproject.toml package.xml \
	$(shell find estimator_pkg sim_pkg resource launch config layouts -type f -not -name '*.pyc')

# Modules are compiled when they are imported (pip's --no-compile: a third of the time, 50 MB).
# Without its cache pytest takes half a minute to read the tests in five processes.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-all test-fast test-slow test-export bench figures install check clean

demo: $(DEMO)
	@$(BIN)/velocity_estimator demo

install: $(ALL)

$(DEMO): EXTRAS := ros,report
$(ALL): EXTRAS := all
$(DEMO) $(ALL): $(SOURCES)
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 10) <= v <= (3, 14) else \
	  f"Python 3.10 to 3.14 is needed, {sys.executable} is {v[0]}.{v[1]}: make PYTHON=...")'
	@test -x $(BIN)/python || { echo "making $(VENV)"; $(PYTHON) -m venv $(VENV); }
	@echo "installing velocity_estimator[$(EXTRAS)] with ROS 2 Jazzy into $(VENV)"
	@rm -rf build *.egg-info
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile '.[$(EXTRAS)]'
	@rm -rf build *.egg-info
	@touch $@ $(DEMO)

# Tests run on the installed package, not on the checkout next to it.
# Three workers begin with the tests over DDS, which also wait; one, and ruff and mypy, compute.
test: install
	@$(MAKE) --no-print-directory --jobs 2 check test-all

test-all: install
	$(BIN)/pytest -n 4

test-fast: install
	$(BIN)/pytest -m "not dds and not slow and not page and not long" -n 2

test-slow: install
	$(BIN)/pytest -m slow -o faulthandler_timeout=7200

# Exported headers with all compilers and settings; on other machines with qemu-user and ziglang.
test-export: install
	$(BIN)/pytest test/export -m 'slow or not slow' -n 2

figures: install
	$(BIN)/python -m docs.tools.figures

BENCH ?=
bench: install
	$(BIN)/python -m benchmarks $(BENCH)

check: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy

clean:
	rm -rf $(VENV) build install log *.egg-info
