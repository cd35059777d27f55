#!/bin/sh
# exported_symbols.sh LIBRARY SONAME: nothing is exported but kmb_, and the library has its name.
set -eu
others=$(nm -D --defined-only "$1" | awk '$3 !~ /^kmb_/ { print $3 }')
if [ -n "$others" ]; then
    echo "exported beside kmb_: $others"
    exit 1
fi
objdump -p "$1" | grep -q "SONAME  *$2\$" || { echo "the SONAME is not $2"; exit 1; }
