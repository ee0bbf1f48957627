# Everything a person types. `make setup` builds .venv and is a no-op when it is current.
PYTHON ?= $(shell for v in 3.11 3.12 3.13; do python$$v -c "" 2>/dev/null && echo python$$v && break; done)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.current
DEMO ?= scenarios/helsinki

.PHONY: help setup demo check test storms bench map-score contacts cluster-bench study image up watch down logs fetch-run cluster-test chaos clean
.DEFAULT_GOAL := help

help: ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 10

setup: $(STAMP) ## build .venv from both locks

$(STAMP): requirements.lock requirements-test.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock -r requirements-test.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@find shared -name '*.nb[ic]' -delete  # compiled kernels of another version may name modules that are gone
	@touch $@

demo: setup ## map a district of Helsinki with three robots, on a live page, and write its report
	$(BIN)/orograph doctor --quiet
	$(BIN)/orograph run $(DEMO) --view

check: setup ## style, types, layering
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: setup ## every test: units, protocol storms, processes over Zenoh
	$(BIN)/pytest

storms: setup ## seeded faults over the real services, on all cores: SEEDS=10000, or one of them again: SEED=17
	PYTHONPATH=tests $(BIN)/python -m simnet.storms $(if $(SEED),--seed $(SEED),--seeds $(or $(SEEDS),1000))

bench: setup ## the hot paths, as a table and a last JSON line
	$(BIN)/python tests/bench/main.py

map-score: setup ## how true the maps are, by rule set: RULES=paper,surface SCENARIOS=tiny PRIORS=honest SEEDS=3 DETAILS=1
	$(BIN)/python tests/bench/map_score.py $(if $(RULES),--rules $(RULES)) $(if $(SCENARIOS),--scenarios $(SCENARIOS)) \
		$(if $(PRIORS),--priors $(PRIORS)) $(if $(SEEDS),--seeds $(SEEDS)) $(if $(DETAILS),--details)

contacts: setup ## how safe missions are: SEEDS=100 SCENARIOS=helsinki ROBOTS=10
	$(BIN)/python tests/bench/contacts.py $(if $(SEEDS),--seeds $(SEEDS)) $(if $(SCENARIOS),--scenarios $(SCENARIOS)) \
		$(if $(ROBOTS),--robots $(ROBOTS)) --jobs $$(nproc)

cluster-bench: setup image ## what the cluster costs beside local processes: speed, memory, delay, claims
	PYTHONPATH=tests $(BIN)/python tests/bench/cluster.py

study: setup ## the paper's Table 3: mapping time with one, two and three robots
	$(BIN)/orograph study scenarios/paper --robots 1,2,3

image: ## build the image of all services
	ops/offline-images
	docker build --quiet --file ops/Dockerfile --tag orograph . >/dev/null

up: image ## start the cluster in containers: ROBOTS=3 SCENARIO=tiny SEED= TIME_SCALE= START_WITH= CONSOLE_PORT=
	ops/up

watch: ## add Prometheus and Grafana to the cluster, on loopback
	ops/watch

down: ## end the cluster; its volume with the runs stays
	STATUS_PORT=1 ops/compose --profile '*' down --timeout 4

logs: ## follow the cluster's logs
	ops/compose logs --follow --tail 50

fetch-run: ## copy the cluster's newest run to runs/
	ops/fetch-run

cluster-test: setup image ## the tests in containers (needs a Docker engine)
	$(BIN)/pytest -m containers

chaos: setup image ## break the cluster and judge what it recorded, about an hour at most: ONLY=F1,F8
	PYTHONPATH=tests $(BIN)/python -m chaos.runner --only "$(ONLY)"

clean: ## remove .venv and runs
	rm -rf $(VENV) runs
