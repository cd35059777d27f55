#!/bin/sh
# run.sh BUILD_FOLDER THIS_FOLDER SCRATCH: installs into a prefix, and builds a project that knows nothing but that prefix,
# by find_package and by pkg-config.
set -eu
build=$1 here=$2 scratch=$3
rm -rf "$scratch"
mkdir -p "$scratch/project"
cmake --install "$build" --prefix "$scratch/prefix" > /dev/null
cp "$here/CMakeLists.txt" "$here/main.c" "$scratch/project"

cmake -S "$scratch/project" -B "$scratch/build" -DCMAKE_PREFIX_PATH="$scratch/prefix" > /dev/null
cmake --build "$scratch/build" > /dev/null
"$scratch/build/shared"
"$scratch/build/static"

libraries=$(dirname "$(find "$scratch/prefix" -name libkimberlite.so.0)")
export PKG_CONFIG_PATH="$libraries/pkgconfig"
cc -std=c99 -Wall -Wextra -Wpedantic -Werror -o "$scratch/packaged" "$scratch/project/main.c" \
    $(pkg-config --cflags --libs kimberlite)
LD_LIBRARY_PATH="$libraries" "$scratch/packaged"
