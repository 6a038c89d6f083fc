#!/bin/sh
# Cargo's runner for the boards: `run-in-emulator.sh IMAGE [OPTIONS OF cardan run]`.
#
# The program's exit code (r24 at its end) becomes this one's. CARDAN names the command line if it is
# built already; otherwise cargo builds it, with the workspace's settings and not the board's.
set -e
image=$(realpath "$1")
shift
if [ -z "$CARDAN" ]; then
    cd "$(dirname "$(realpath "$0")")/../.."
    unset RUSTC RUSTC_BOOTSTRAP RUSTC_WRAPPER RUSTFLAGS CARGO_ENCODED_RUSTFLAGS CARGO_BUILD_TARGET
    exec cargo run --quiet --release --package cardan -- run "$image" --program-exit "$@"
fi
exec "$CARDAN" run "$image" --program-exit "$@"
