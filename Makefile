# The front door. Every target installs and builds what is missing, and is safe to repeat.
# Another python3 (pyenv, conda) may stand first on PATH; ROS belongs to the system's.
SHELL := /bin/bash
export PATH := /usr/bin:$(PATH)
PYTHON := /usr/bin/python3
BUILD := build
ENV := set -e; [ ! -f /opt/ros/noetic/setup.bash ] || source /opt/ros/noetic/setup.bash;
DEVEL := $(ENV) source $(BUILD)/devel/setup.bash;

.PHONY: help setup build demo test test-py38 soak bench docs lint clean

help:
	@echo 'make demo    see it drive     (RVIZ=1: in rviz too; IMAGES=folder: on your own pictures)'
	@echo 'make test    test everything'
	@echo 'make test-py38  test what needs no ROS with the robot'"'"'s Python 3.8, OpenCV 4.2, numpy 1.17 and scikit-image 0.16'
	@echo 'make soak    drive in the simulator for 20 minutes, and look for what grows'
	@echo 'make bench   time each stage (IMAGES=folder: on your own pictures)'
	@echo 'make docs    build the documentation into build/docs'
	@echo 'make lint    check style and types'
	@echo 'make setup   install what is missing; make build: build into build/'

setup:
	@bash deps/install
	@bash deps/venv $(BUILD)

build: setup
	@$(ENV) bash deps/configure $(BUILD) && cmake --build $(BUILD) >$(BUILD)/build.log || { tail -n 30 $(BUILD)/build.log; exit 1; }

demo: build
	@$(DEVEL) rosrun obst_avoid demo --output $(BUILD)/demo $(if $(IMAGES),--images '$(IMAGES)') \
	  $(if $(CALIBRATION),--calibration '$(CALIBRATION)') $(if $(VEHICLE),--vehicle '$(VEHICLE)') $(if $(RVIZ),--rviz)

test: build
	@bash deps/install desktop docs
	@$(DEVEL) test/run $(BUILD)

test-py38:
	@deps/test_py38 $(BUILD)

soak: build
	@$(DEVEL) rosrun obst_avoid soak --output $(BUILD)/soak.json

bench: build
	@$(DEVEL) rosrun obst_avoid bench --output $(BUILD)/bench.json $(if $(IMAGES),'$(IMAGES)')

docs: build
	@bash deps/install docs
	@$(DEVEL) /usr/bin/python3 -m sphinx -a -W --keep-going -q -b html docs $(BUILD)/docs
	@echo "$(BUILD)/docs/index.html"

lint: setup
	@bash deps/lint_tools $(BUILD)/lint
	@.ci/lint $(BUILD)/lint

clean:
	rm -rf $(BUILD)
