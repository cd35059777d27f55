#!/usr/bin/env bash
# Runs one of the programs beside it in a virtual environment of pinned packages under target/, made when it is missing or old.
# usage: run.sh measure|colour|chart [options]    (each has --help)
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
environment=$(cd "$here/../.." && pwd)/target/peers/python
wanted=$here/requirements.txt
if [ $# -lt 1 ] || [ ! -f "$here/$1.py" ]; then
    sed -n '3s/^# //p' "$0" >&2
    exit 2
fi
if ! cmp -s "$wanted" "$environment/installed.txt"; then
    if ! python3 -c 'import ensurepip, venv' 2>/dev/null; then
        sudo=$([ "$(id -u)" = 0 ] || echo sudo)
        $sudo apt-get update -qq
        $sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends python3-venv
    fi
    mkdir -p "$environment"
    python3 -m venv --clear "$environment"
    "$environment/bin/pip" install --quiet --disable-pip-version-check -r "$wanted"
    cp "$wanted" "$environment/installed.txt"
fi
program=$1
shift
# One core for everyone: SZ3 asks OpenMP.
export OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1
exec "$environment/bin/python" "$here/$program.py" "$@"
