# The commands of the README, and the pictures in it. Everything they need is set up in .venv by .ci/setup.
.PHONY: demo view test test-types test-all test-long figures docs clean

demo: .venv/.ready
	mkdir -p out
	.venv/bin/irrsplat render cornell-paper -o out/figures/ --stats out/figures.json
	.venv/bin/irrsplat render cornell -o out/cornell.png
	@echo "See out/figures/ (the paper's figures 1 to 6, and every buffer) and out/cornell.png"

view: .venv/.ready
	.venv/bin/irrsplat view

test: .venv/.ready-dev
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	@$(MAKE) --no-print-directory --keep-going -j2 test-types test-all

# These two side by side: the types keep a core busy for a minute, which would leave another one idle.
test-types: .venv/.ready-dev
	sh .ci/typecheck

test-all: .venv/.ready-dev
	.venv/bin/python -m pytest -q -n auto --dist worksteal

test-long: .venv/.ready-dev
	.venv/bin/python -m pytest -q -n auto -m long

docs: .venv/.ready-dev
	NO_MKDOCS_2_WARNING=1 .venv/bin/python -m mkdocs build --strict --quiet
	@echo "See build/site/index.html"

figures: .venv/.ready
	.venv/bin/python docs/programs/tables.py
	.venv/bin/python docs/programs/figures.py
	.venv/bin/python docs/programs/tutorial.py
	.venv/bin/python docs/programs/screens.py
	.venv/bin/python docs/programs/walk.py

.venv/.ready: pyproject.toml .ci/setup
	sh .ci/setup

.venv/.ready-dev: pyproject.toml .ci/setup
	sh .ci/setup dev

clean:
	rm -rf .venv out build *.egg-info
