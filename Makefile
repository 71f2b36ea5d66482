# All targets work in a fresh clone and need only Python 3.11+ and make.
PYTHON ?= python3
BIN := .venv/bin
TOOLS := .venv/tools/bin

WEB := mission_service/interfaces/web
MAP := $(WEB)/dist/index.html
MAP_SOURCES := $(wildcard $(addprefix $(WEB)/,*.json *.html *.ts src/*.* src/panels/*.* src/languages/*.* public/*.*))

# The processes of tests share compiled modules, also where the environment turns this off.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo docs test long lint kernels format clean mosquitto chromium web lock sbom audit

# What the service needs at run time; prints what it installs, and how far each download is.
.venv/product: pyproject.toml | $(MAP)
	$(BIN)/python -m pip install --disable-pip-version-check --editable .
	@touch $@

$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $(PYTHON) is older than 3.11; run make PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv .venv

# Also what tests and developers need.
.venv/ready: .venv/product
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

# Builds the map; Node.js comes from PyPI if the machine has none.
web: $(MAP)

$(MAP): $(MAP_SOURCES) | $(BIN)/pip
	$(BIN)/python -m mission_service.interfaces.web.build
	@touch $@

demo: $(MAP) .venv/product
	$(BIN)/mission-service demo --out out

# Builds the documentation, which "mission-service docs" serves and later wheels contain.
docs: .venv/ready
	$(BIN)/python -m docs.site.build

# Many tests wait for real time, so that two cores serve more than two processes. If one of them ends,
# xdist would wait forever for its tests. Failures are printed at once.
PYTEST := $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --max-worker-restart=0 \
  --instafail

test: .venv/ready $(MAP) mosquitto chromium
	$(MAKE) --jobs=2 --output-sync=target lint kernels
	$(PYTEST)

# Tests that take too long for every change; CI runs them after the other tests.
long: .venv/ready $(MAP) mosquitto chromium kernels
	$(PYTEST) -m long

# Installs the MQTT broker for tests, which are skipped without it.
mosquitto:
	@PATH="$$PATH:/usr/sbin"; command -v mosquitto >/dev/null && exit 0; \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    export DEBIAN_FRONTEND=noninteractive; \
	    { apt-get update -qq && apt-get install -y -qq --no-install-recommends mosquitto; } >/dev/null 2>&1; \
	  fi; \
	  command -v mosquitto >/dev/null || \
	    echo "no mosquitto: its tests are skipped; install it by: apt-get install mosquitto" >&2

# Installs the browser for tests of the map, which are skipped without it.
chromium:
	@command -v chromium >/dev/null && exit 0; \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    export DEBIAN_FRONTEND=noninteractive; \
	    { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium; } >/dev/null 2>&1; \
	  fi; \
	  command -v chromium >/dev/null || \
	    echo "no chromium: the map's tests are skipped; install it by: apt-get install chromium" >&2

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

# Compiles the kernels once, so that the processes of tests load them from the disk cache.
kernels: .venv/ready
	$(BIN)/python -m mission_service.live.compile_kernels

# The versions and hashes of all packages in the container, for each platform.
LOCK := $(TOOLS)/uv pip compile --quiet --no-config --universal --python-version 3.11 --generate-hashes \
  --custom-compile-command "make lock" --default-index https://pypi.org/simple

lock: .venv/tools/ready
	$(LOCK) --extra serial --extra notify pyproject.toml --output-file docker/requirements.txt
	$(LOCK) docker/build-requirements.in --output-file docker/build-requirements.txt

# The software bill of materials of the container (CycloneDX), for a security review.
sbom: .venv/tools/ready
	@mkdir -p out
	$(TOOLS)/cyclonedx-py requirements docker/requirements.txt --pyproject pyproject.toml \
	  --output-reproducible --output-file out/sbom.json

# Known vulnerabilities of the packages in the container; needs the advisories of pypi.org.
audit: .venv/tools/ready
	$(TOOLS)/pip-audit --strict --requirement docker/requirements.txt --disable-pip --no-deps

.venv/tools/ready: | $(BIN)/pip
	$(BIN)/python -m venv .venv/tools
	$(TOOLS)/python -m pip install --quiet --disable-pip-version-check uv cyclonedx-bom pip-audit
	@touch $@

format: .venv/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(WEB)/dist $(WEB)/node_modules mission_service/interfaces/manual/site.zip .venv out .mypy_cache .ruff_cache .pytest_cache .hypothesis
