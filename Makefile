# `make run` and `make test` are all a newcomer needs: both set up .venv first, without root and without a screen.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

PAGE := ghal360_robot/telepresence/page

.PHONY: run test detectors test-logbook lint page test-page test-usb test-usb-short campaign explore drives fuzz soak soak-lidar mutate pictures clean

run: $(VENV)/.installed page $(VENV)/.detectors
	$(BIN)/ghal360 demo

# Most tests wait for wires: four at a time, whole robots by themselves afterwards. Both keep real time; what fails
# is run once more, and counts if it fails again: a shared machine may stand still for a second.
SHORT := not campaign and not page
AGAIN := { [ $$? -eq 1 ] && $(BIN)/pytest --last-failed --last-failed-no-failures none; }

test: $(VENV)/.installed page lint $(VENV)/.detectors
	$(BIN)/pytest -n 4 --dist loadfile -m "$(SHORT) and not alone" || $(AGAIN)
	$(BIN)/pytest -m "$(SHORT) and alone" || $(AGAIN)

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The telepresence page; without Node everything else works.
page: $(PAGE)/dist/index.html

$(PAGE)/dist/index.html: $(PAGE)/package-lock.json $(PAGE)/index.html $(wildcard $(PAGE)/src/*)
	@node -e 'process.exit(+(process.versions.node.split(".")[0] < 20))' 2>/dev/null && command -v npm >/dev/null || \
		{ echo "Node 20 or newer with npm is not there: the telepresence page is left out."; exit 0; }; \
		cd $(PAGE) && { [ node_modules/.package-lock.json -nt package-lock.json ] || \
		npm ci --no-audit --no-fund --ignore-scripts --loglevel=error; } && npm run build --silent

# The whole page in a real Chromium (apt install chromium) on a simulated robot: four minutes.
test-page: $(VENV)/.installed page
	$(BIN)/pytest -m page --timeout=600 tests/end_to_end

# The camera's driver on a real Linux kernel in a virtual machine: five minutes on two idle cores, or the short form
# in one. Needs qemu-system-x86 installed and Debian's package lists; root for nothing.
test-usb: $(VENV)/.installed
	$(BIN)/python -m tests.usb_kernel.run

test-usb-short: $(VENV)/.installed
	$(BIN)/python -m tests.usb_kernel.run smoke

# Ten searches through all wires in real time, many more in simulated time: about twenty minutes.
campaign: $(VENV)/.installed
	$(BIN)/pytest -m campaign --timeout=3600

# The properties again, each with two thousand examples that nobody has seen: about ten minutes.
explore: $(VENV)/.installed
	$(BIN)/pytest -n 2 --hypothesis-profile explore --timeout=3600 -m "hypothesis and $(SHORT)"

# 2,000 random drives among walking people, half a minute each, in simulated time: about half an hour on two cores.
drives: $(VENV)/.installed
	$(BIN)/python benchmarks/drives.py --drives 2000

# Ten minutes of hostile bytes each for the lidar's and the camera's codecs, guided by coverage where atheris can be had;
# a failing input is left in fuzz/.
fuzz: $(VENV)/.installed
	-$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[sim,export,dev,fuzz]'
	$(BIN)/python fuzz/tim571.py --seconds 600
	$(BIN)/python fuzz/theta_v.py --seconds 600

# What the logbook does when viewers, disks and the process itself fail: about eight minutes.
test-logbook: $(VENV)/.installed
	$(BIN)/python -m benchmarks.logbook_faults

# A simulated day of driving with 4,500 faults on bus and base: about ten minutes on one core.
soak: $(VENV)/.installed
	$(BIN)/python -m benchmarks.soak --hours 24

# Half an hour of lidar scans in two minutes, then a hundred reconnects: nothing may grow or stay behind.
soak-lidar: $(VENV)/.installed
	$(BIN)/python benchmarks/lidar_soak.py

# Breaks the safety chain in three thousand small ways, one at a time, and asks its tests whether they notice: about
# a quarter of an hour on two cores. Fails below 95 %; docs/mutation.md explains those that are left.
mutate: $(VENV)/.installed
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[sim,dev,mutation]'
	rm -rf mutants
	$(BIN)/mutmut run --max-children 2
	$(BIN)/mutmut results
	$(BIN)/mutmut export-cicd-stats
	@$(BIN)/python -c 'import json; s = json.load(open("mutants/mutmut-cicd-stats.json")); \
	  share = (s["killed"] + s["timeout"]) / s["total"]; print(f"{share:.1%} noticed"); \
	  raise SystemExit(share < 0.95)'

# CenterNet's weights from npm (29 MB), kept in the user's cache. Without npm or network this says in one sentence what
# to do instead, and everything else goes on: the simulated world has a detector of its own.
detectors: $(VENV)/.detectors

$(VENV)/.detectors: | $(VENV)/.installed
	@$(BIN)/ghal360 detectors add centernet && touch $@ || true

# The pictures under docs/.
pictures: $(VENV)/.installed
	$(BIN)/ghal360 pictures docs

$(VENV)/.installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed (set PYTHON=...)"; exit 1; }
	$(PYTHON) -m venv $(VENV) || { echo "python3-venv is missing: apt install python3-venv"; exit 1; }
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[sim,export,experiments,dev]'
	@touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache
