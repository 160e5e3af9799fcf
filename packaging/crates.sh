#!/usr/bin/env bash
# Packages the crates of the library as crates.io takes them, without compiling them again, and prints their size:
#
#     packaging/crates.sh
set -euo pipefail
cd "$(dirname "$0")/.."
# (The others are used by this project only.)
cargo package --quiet --workspace --exclude 'spinney-*-tests' --exclude spinney-capi --exclude spinney-python \
    --no-verify --allow-dirty --locked
du --bytes --total "${CARGO_TARGET_DIR:-target}"/package/*.crate | awk 'END { printf "crates: %.1f MB\n", $1 / 1e6 }'
