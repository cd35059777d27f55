# make demo    on a fresh Debian: installs what is missing, builds, flies over data/'s Puget Sound, leaves pictures in target/demo
# make check   every test and check of the project
# make sweep   DATA=folder: builds, verifies and extracts every raster of a folder by every transform and coder at three errors and lossless
# make peers   measures other codecs and ours on the same rasters at the same maximum errors; DATA=folder, ARGS=more options
# make chart   the same for the charts of docs/charts/, and redraws them, then make flights; ARGS=--redraw draws the last measurements again,
#              IMAGE=file adds colour, FILE=x.kmb is flown over
# make flights triangles against the error on the screen, the time of an update, and recovery from a jump, for docs/charts/: over FILE=x.kmb, else over
#              the largest GeoTIFF of DATA or data/, built at a max error of 1; ARGS="--parts frame,jump" only what is timed
# make rays    rays against the finest surface, ours and Embree's on the same triangles; FILE and DATA as for flights; ARGS="--rays N --scenes mesh"
# make cities  bytes of cities against their likeness to their triangles, and a flight through 20,000 generated buildings, for docs/charts/; DATA=folder of
#              CityJSON, ARGS="--buildings N"
# make city-rays primary rays against BlockMaps, and Embree's against the triangles that they were built from
# make storage the same blocks in our file, LMDB, redb and SQLite: size, opening, look-ups, scans; FILE=x.kmb, ARGS="--grow MIB" repeats its blocks
# make soak    the long runs: a thousand flipped bits and a thousand truncations through every command that reads; a build killed at fifty
#              instants; 410 million samples in 256 MiB, which take 8 GB of disk and for comparison 10 GB of memory;
#              20,000 random legal cuts without a crack, half of them with colours and detail, 30,000 settled ones as good as fresh ones, 10,000 whose diamonds threads
#              decode; four viewers on one repository for ten minutes; a million heights of a raster;
#              100,000 rays against every triangle; 10 million into cities of mixed levels, and 10 million by both casters of BlockMaps; 500 pictures
#              of random mixes of levels
# make header  regenerates include/kimberlite.h
# make deps    only what the others install

.DEFAULT_GOAL := demo
SHELL := /bin/bash
BUILD := target/cmake
DEMO := target/demo
KMB := target/release/kmb
PACKAGES := cmake pkg-config g++ libglfw3-dev libosmesa6-dev libpng-dev libgl-dev xvfb xauth valgrind libc6-dbg imagemagick python3
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)

.PHONY: demo check deps build library examples header sweep peers chart flights rays cities city-rays storage soak clean

deps:
	@missing=""; for p in $(PACKAGES); do dpkg -s $$p 2>/dev/null | grep -q '^Status: install ok installed' || missing="$$missing $$p"; done; \
	if [ -n "$$missing" ]; then echo "installing$$missing"; \
	$(SUDO) apt-get update -qq && DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -qq --no-install-recommends $$missing; fi

build: deps
	cargo build --release --locked
	cmake -S . -B $(BUILD) -DCMAKE_BUILD_TYPE=Release
	cmake --build $(BUILD) --parallel 2

demo: build
	bash c_examples/demo.sh $(KMB) $(BUILD) $(DEMO)

header:
	KMB_WRITE_HEADER=1 cargo test --locked --test header

check: build
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	cargo clippy --locked --no-default-features -- -D warnings
	cargo test --locked
	ctest --test-dir $(BUILD) --output-on-failure
	cmake -S . -B $(BUILD)-sanitized -DKMB_SANITIZE=ON
	cmake --build $(BUILD)-sanitized --parallel 2
	ctest --test-dir $(BUILD)-sanitized --output-on-failure

sweep: build
	@test -n "$(DATA)" || { echo "give a folder of rasters: make sweep DATA=folder"; exit 2; }
	KIMBERLITE_DATA="$(abspath $(DATA))" cargo test --locked --release --test terrain elevation -- --nocapture

peers:
	cargo build --release --locked
	@mkdir -p target/peers
	bash benches/peers/run.sh measure --csv target/peers/measured.csv $(if $(DATA),--data "$(abspath $(DATA))") $(ARGS)

chart:
	cargo build --release --locked
	cargo test --locked --test terrain depth -- --nocapture | grep -E '^(e|[0-9]+),' > docs/charts/depth.csv
	bash benches/peers/run.sh chart $(if $(DATA),--data "$(abspath $(DATA))") $(ARGS)
	$(if $(IMAGE),bash benches/peers/run.sh colour "$(abspath $(IMAGE))" --csv docs/charts/colour.csv --svg docs/charts/colour.svg,\
		@echo "no IMAGE=file: colour is not measured again")
	$(if $(findstring --redraw,$(ARGS)),python3 -B benches/peers/flights.py docs/charts,$(MAKE) flights ARGS=)

# A package of its own, as check need not compile it.
flights:
	@mkdir -p target/flights
	cargo build --release --locked
	cargo build --release --locked --manifest-path benches/flights/Cargo.toml --target-dir target
	@set -e; file="$(FILE)"; folder="$(or $(DATA),data)"; \
	if [ -z "$$file" ]; then \
		raster=$$(ls -S "$$folder"/*.tif 2>/dev/null | head -n 1); \
		if [ -z "$$raster" ]; then echo "flights: skipped, there is no GeoTIFF in $$folder and no FILE=x.kmb"; exit 0; fi; \
		echo "flights: no FILE=x.kmb, so over $$raster; its other rasters are skipped"; \
		file=target/flights/$$(basename "$$raster" .tif).kmb; \
		$(KMB) build "$$raster" -o "$$file" --max-error 1; \
	fi; \
	target/release/flights-bench "$$file" --out docs/charts $(ARGS); \
	python3 -B benches/peers/flights.py docs/charts

# Not in PACKAGES, as nothing else needs Embree.
rays:
	@mkdir -p target/rays
	@dpkg -s libembree-dev 2>/dev/null | grep -q '^Status: install ok installed' || $(MAKE) deps PACKAGES="g++ libembree-dev"
	cargo build --release --locked
	g++ -O3 -std=c++17 -Wall -Wextra -Iinclude benches/rays/rays.cpp -o target/rays/rays-bench target/release/libkimberlite.a -lembree3 -lpthread -ldl -lm
	@set -e; file="$(FILE)"; folder="$(or $(DATA),data)"; \
	if [ -z "$$file" ]; then \
		raster=$$(ls -S "$$folder"/*.tif 2>/dev/null | head -n 1); \
		if [ -z "$$raster" ]; then echo "rays: skipped, there is no GeoTIFF in $$folder and no FILE=x.kmb"; exit 0; fi; \
		echo "rays: no FILE=x.kmb, so over $$raster; its other rasters are skipped"; \
		file=target/rays/$$(basename "$$raster" .tif).kmb; \
		$(KMB) build "$$raster" -o "$$file" --max-error 1; \
	fi; \
	target/rays/rays-bench "$$file" $(ARGS)

# DATA is a folder of cities; what it does not have is said.
cities:
	@mkdir -p target/cities
	cargo build --release --locked
	cargo build --release --locked --manifest-path benches/cities/Cargo.toml --target-dir target
	@set -e; inputs=$$(ls "$(or $(DATA),data/city)"/*.city.json "$(or $(DATA),data/city)"/*/*.city.json 2>/dev/null || true); \
	if [ -z "$$inputs" ]; then echo "cities: skipped, there is no CityJSON in $(or $(DATA),data/city)"; else \
	python3 -B benches/peers/cities.py measure $(KMB) docs/charts $$inputs; fi; \
	rm -f target/cities/city.kmb; \
	$(KMB) build data/puget_sound_1025_decimetres.png -o target/cities/terrain.kmb --max-error 5 --spacing 160 --scale 0.1; \
	target/release/cities-bench target/cities/terrain.kmb target/cities/city.kmb --csv docs/charts/city_flight.csv $(ARGS); \
	python3 -B benches/peers/cities.py draw docs/charts

# Not in PACKAGES, as nothing else needs Embree.
city-rays:
	@mkdir -p target/cities
	@dpkg -s libembree-dev 2>/dev/null | grep -q '^Status: install ok installed' || $(MAKE) deps PACKAGES="g++ libembree-dev"
	cargo build --release --locked
	cargo build --release --locked --manifest-path benches/cities/Cargo.toml --target-dir target
	g++ -O3 -std=c++17 -Wall -Wextra -Iinclude benches/cities/embree.cpp -o target/cities/embree target/release/libkimberlite.a -lembree3 -lpthread -ldl -lm
	target/release/triangles target/cities/delft.bin data/city/delft_lod1.city.json
	target/cities/embree target/cities target/cities/delft.bin
	target/cities/embree target/cities

# Its own package, as check need not compile three databases.
storage:
	@mkdir -p target/storage
	$(if $(FILE),,cargo build --release --locked && $(KMB) build data/srtm3_S33W071.tif -o target/storage/andes.kmb --max-error 12)
	cargo run --release --locked --manifest-path benches/storage/Cargo.toml --target-dir target -- \
		$(or $(FILE),target/storage/andes.kmb) --csv target/storage/measured.csv $(ARGS)

soak: build
	KIMBERLITE_SOAK=1 cargo test --locked --release --test command_line -- --nocapture --test-threads 1 damage:: resume:: large::
	KIMBERLITE_CASES=10000 cargo test --locked --release --test cut -- conformity:: grounds:: best:: threads::
	KIMBERLITE_SOAK=1 cargo test --locked --release --test cut -- --nocapture heights:: ray_hits::
	KIMBERLITE_SOAK=1 cargo test --locked --release --test viewers -- --nocapture
	KIMBERLITE_CASES=50000 cargo test --locked --release --test city -- casting::
	KIMBERLITE_SOAK=1 cargo test --locked --release --test city -- seams::
	@mkdir -p target/soak
	$(BUILD)/ffi_tests/city_shader target/soak data/city/delft_lod1.city.json 500 192

clean:
	rm -rf target
