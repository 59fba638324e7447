# The commands of the README, and the pictures in it. Everything they need is set up in .venv by .ci/setup.
.PHONY: demo view test test-long test-stress figures docs clean

demo: .venv/.ready
	mkdir -p out
	.venv/bin/irrsplat render cornell-paper -o out/figures/ --stats out/figures.json
	.venv/bin/irrsplat render cornell -o out/cornell.png
	@echo "See out/figures/ (the paper's figures 1 to 6, and every buffer) and out/cornell.png"

view: .venv/.ready
	.venv/bin/irrsplat view

# The quick checks come first, so that their faults show within a minute.
test: .venv/.ready-dev
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	sh .ci/typecheck --num-workers 2
	.venv/bin/python -m pytest -q -n auto --dist worksteal --durations 10

test-long: .venv/.ready-dev
	.venv/bin/python -m pytest -q -n auto --dist worksteal --durations 10 -m long

# The whole suite under load, in random order and in one process: no outcome may change. Takes about 50 minutes on two cores.
test-stress: .venv/.ready-dev
	sh .ci/stress

docs: .venv/.ready-dev
	NO_MKDOCS_2_WARNING=1 .venv/bin/python -m mkdocs build --strict --quiet
	@echo "See build/site/index.html"

figures: .venv/.ready
	.venv/bin/python docs/programs/tables.py
	.venv/bin/python docs/programs/figures.py
	.venv/bin/python docs/programs/tutorial.py
	.venv/bin/python docs/programs/viewer/screens.py
	.venv/bin/python docs/programs/viewer/clip.py
	.venv/bin/python docs/programs/viewer/walk.py

.venv/.ready: pyproject.toml .ci/setup
	sh .ci/setup

.venv/.ready-dev: pyproject.toml .ci/setup
	sh .ci/setup dev

clean:
	rm -rf .venv out build *.egg-info
