# Everything runs in .venv, made from constraints.txt, and Blender in .venv-blender, made from
# blender/requirements.txt; `make demo` and `make test` set up both themselves.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# Nothing where the environment names another Python for Blender.
BLENDER := $(if $(GMRDATA_BLENDER_PYTHON),,.venv-blender/requirements.txt)
PYTHONS ?= 3.11 3.12 3.13
EXTRAS ?= dev

.PHONY: setup demo test lint bench bench-render bench-sfm bench-real bench-video bench-poses bench-people bench-long bench-open bench-odd bench-scale soak fuzz bench-gmr bench-gmr-cmu bench-folds bench-fusion bench-tables docs pictures pythons release clean

setup: $(READY) $(BLENDER)

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$(EXTRAS)]'
	touch $@

.venv-blender/requirements.txt: blender/requirements.txt | $(READY)
	$(BIN)/gmrdata blender setup
	touch $@

demo: setup
	$(BIN)/gmrdata demo $(if $(MOTIONS),--motions "$(MOTIONS)") $(if $(OUT),--out "$(OUT)")

# Two processes of one thread each; the tests of a file stay together, since they share what is slow to make, and slow files come first.
# Byte code is kept, whatever the shell says: each of many processes would compile all modules, and those of the tests with their assertions.
test: setup
	OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(ARGS)

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: setup
	$(BIN)/python -m pytest benchmarks -m bench -o python_files='bench_*.py' -s

# The Blender stage alone; `make bench` runs it too. ARGS=--small only tries every part.
bench-render: setup
	$(BIN)/python -m pytest benchmarks/bench_render.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# The COLMAP stage alone, on twins of 3DPW.  ARGS=--small only tries every part; ARGS='--twins FOLDER' takes twins that are there.
bench-sfm: setup
	$(BIN)/python -m pytest benchmarks/bench_sfm.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# The COLMAP stage on real clips.  ARGS='--clips FOLDER' says where they are, --small only tries every part, -k picks cases.
bench-real: setup
	$(BIN)/python -m pytest benchmarks/bench_real.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# Any video: lens, people of other systems, real videos.  ARGS='--clips FOLDER --videos FOLDER' says where real ones are, --small tries every part.
bench-video: setup
	$(BIN)/python -m pytest benchmarks/bench_video.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# The built-in local poses, on rendered people of CMU's subjects 02 and 08.  ARGS=--small only tries every part.
bench-poses: setup
	$(BIN)/python -m pytest benchmarks/bench_poses.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# People before the camera, on real people whose truth something else measured.  ARGS=--small takes one view.
bench-people: setup
	$(BIN)/python -m pytest benchmarks/bench_people.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# How time and memory grow with a video's length.  ARGS='--lengths 300 626' takes only these, --small the shortest.
bench-long: setup
	$(BIN)/python -m pytest benchmarks/bench_long.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# Other people's files in and out.  ARGS='--bvh FOLDER' reads their BVH files.
bench-open: setup
	$(BIN)/python -m pytest benchmarks/bench_open.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# Files of public reports, by their READMEs.  ARGS='-k mkv' picks some.
bench-odd: setup
	$(BIN)/python -m pytest benchmarks/bench_odd.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# Many clips and many processes.  ARGS=--small only tries every part.
bench-scale: setup
	$(BIN)/python -m pytest benchmarks/bench_scale.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# An hour of faults, whose runs must end with the bytes of undisturbed ones.  ARGS='--hours 8' takes longer, --small tries every part.
soak: setup
	$(BIN)/python -m pytest benchmarks/bench_soak.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# Ten minutes of changed files for every reader.  ARGS='--minutes 60' takes longer, '--target bvh' tries one reader alone.
fuzz: setup
	$(BIN)/python -m pytest benchmarks/bench_fuzz.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# GMR's training step.  ARGS=--small only tries every part.
bench-gmr: setup
	$(BIN)/python -m pytest benchmarks/bench_gmr.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# GMR on CMU motions without subjects 02 and 08, scored on these.  ARGS=--small only tries every part.
bench-gmr-cmu: setup
	$(BIN)/python -m pytest benchmarks/bench_gmr_cmu.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# The bundled GMR's recipe without two of CMU's 19 people at a time, scored on these.  ARGS=--small only tries every part.
bench-folds: setup
	$(BIN)/python -m pytest benchmarks/bench_folds.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# Cameras and a network together, on twins.  ARGS='--twins FOLDER --pseudo-gt FOLDER --gmr RUN' takes what is there, --small tries every part.
bench-fusion: setup
	$(BIN)/python -m pytest benchmarks/bench_fusion.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# Tables 5, 6 and 10 with the built-in estimator in VIBE's place, and frozen people.  ARGS='--twins FOLDER --gmr RUN' takes what is there, --small tries every part.
bench-tables: setup
	$(BIN)/python -m pytest benchmarks/bench_tables.py -m bench -o python_files='bench_*.py' -s $(ARGS)

# The pages of docs/ as a site, out/site/index.html; no broken link is let through.
docs: $(READY)
	$(BIN)/python -c 'import mkdocs, material, mkdocstrings_handlers.python' 2>/dev/null || \
		$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

# The pictures of docs/ and README, by this version: renders for minutes.  ARGS='--demo FOLDER' takes a demo that is there.
pictures: setup
	$(BIN)/python benchmarks/pictures.py $(ARGS)

# Sdist and wheel of the last commit, each installed where nothing is, and every verb tried there.  ARGS='--keep FOLDER' leaves all in that folder.
release: $(READY)
	$(BIN)/python benchmarks/release.py $(ARGS)

# The suite on every Python at hand, each in an environment of its own, out/pythons/3.12 and so on, with the
# registry's torch: gigabytes.  PYTHONS='3.12 3.13' picks them, ARGS go to pytest.
pythons:
	failed=; for version in $(PYTHONS); do \
		python$$version -c '' 2>/dev/null || { echo "no python$$version here"; continue; }; \
		$(MAKE) test PYTHON=python$$version VENV=out/pythons/$$version EXTRAS=dev,docs,maskrcnn || \
			failed="$$failed $$version"; \
	done; test -z "$$failed" || { echo "failed on$$failed"; exit 1; }

clean:
	rm -rf out build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
