# Everything from a fresh clone, with only Python 3.11+ and make on the machine.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test lint format clean mosquitto

.venv/ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $(PYTHON) is older than 3.11; run make PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

demo: .venv/ready
	$(BIN)/mission-service demo --out out

test: .venv/ready lint mosquitto
	$(BIN)/python -m pytest -n 2 --dist loadfile

# The MQTT broker of some tests, which are skipped without it.
mosquitto:
	@PATH="$$PATH:/usr/sbin"; command -v mosquitto >/dev/null && exit 0; \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    export DEBIAN_FRONTEND=noninteractive; \
	    { apt-get update -qq && apt-get install -y -qq --no-install-recommends mosquitto; } >/dev/null 2>&1; \
	  fi; \
	  command -v mosquitto >/dev/null || \
	    echo "no mosquitto: its tests are skipped; install it by: apt-get install mosquitto" >&2

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: .venv/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf .venv out .mypy_cache .ruff_cache .pytest_cache .hypothesis
