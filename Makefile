# The commands of the repository; `make` alone lists them. Options go into ARGS: make test ARGS="-k consensus"
PYTHON ?= $(shell for python in python3.13 python3.12 python3.11 python3; do $$python -c 'import sys; \
  sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null && echo $$python && break; done)
EXPERIMENT ?= ros_ws/config/patrol.yaml

.PHONY: help setup run simulate test lint docs pythons colcon clean

help: ## list the commands
	@sed -n 's/^\([a-z]*\):.*## /make \1\t/p' $(MAKEFILE_LIST) | expand -t 16

setup: ## make .venv ready; quick when nothing has changed
	@python="$(PYTHON)"; test -n "$$python" || { echo "no Python 3.11, 3.12 or 3.13 found. On Debian 12 or" \
	  "Ubuntu 24.04: sudo apt-get install python3 python3-venv python3-dev gcc g++ make" \
	  "(or name one: make setup PYTHON=/path/to/python3.12)" >&2; exit 3; }; \
	$$python tools/setup_workspace.py

run: setup ## run the patrol experiment on ROS 2, every learner a process of its own
	.venv/bin/mabirds run $(EXPERIMENT) $(ARGS)

simulate: setup ## run the same experiment in one process, without ROS
	.venv/bin/mabirds simulate $(EXPERIMENT) $(ARGS)

test: lint ## lint, then run the tests (the slow ones too: ARGS="-m ''")
	.venv/bin/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder $(ARGS)

lint: setup ## check style and types
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy

docs: setup ## build the documentation into build/site
	NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --strict --quiet

pythons: ## run the tests (those of ARGS) with every other Python from 3.11 to 3.13 that is here
	tools/other_pythons.sh "$(PYTHON)" $(ARGS)

colcon: ## build and test ros_ws with colcon, and hear a node of its install tree
	tools/colcon_workspace.sh $(PYTHON)

clean: ## remove .venv and everything else that was built (runs/ stays)
	rm -rf .venv build ros_ws/build ros_ws/install ros_ws/log .pytest_cache .ruff_cache .mypy_cache .hypothesis
	rm -rf src/*/build src/*/*.egg-info packaging/*/build packaging/*/*.egg-info
	find src ros_ws tests tools -name __pycache__ -prune -exec rm -rf {} +
