# make demo    on a fresh Debian: installs what is missing, builds, flies over data/'s Puget Sound, leaves pictures in target/demo
# make check   every test and check of the project
# make sweep   DATA=folder: builds, verifies and extracts every raster of a folder by every transform at three errors
# make header  regenerates include/kimberlite.h
# make deps    only what the others install

.DEFAULT_GOAL := demo
SHELL := /bin/bash
BUILD := target/cmake
DEMO := target/demo
KMB := target/release/kmb
PACKAGES := cmake pkg-config g++ libglfw3-dev libosmesa6-dev libpng-dev libgl-dev xvfb xauth valgrind libc6-dbg imagemagick
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)

.PHONY: demo check deps build library examples header sweep clean

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

clean:
	rm -rf target
