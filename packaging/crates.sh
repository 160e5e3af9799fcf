#!/usr/bin/env bash
# Packages the library's crates for crates.io, without recompiling them, and prints their size:
#
#     packaging/crates.sh
set -euo pipefail
cd "$(dirname "$0")/.."
# (Only this project uses the excluded crates.)
cargo package --quiet --workspace --exclude 'spinney-*-tests' --exclude spinney-capi --exclude spinney-python \
    --no-verify --allow-dirty --locked
du --bytes --total "${CARGO_TARGET_DIR:-target}"/package/*.crate | awk 'END { printf "crates: %.1f MB\n", $1 / 1e6 }'
