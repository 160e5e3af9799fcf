#!/usr/bin/env bash
# Builds the JavaScript package, and tests it under Node against what the program tells:
#
#     wasm/test.sh
#
# SPINNEY names the program, which is built if it is not said.
# Skipped, which is said, where there is no Node of version 20 or newer, or no library for wasm32-unknown-unknown.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
say() { printf -- '-- %s\n' "$*"; }
if ! [[ $(node --version 2> /dev/null) =~ ^v(2[0-9]|[3-9][0-9])\. ]]; then
    say 'skipped: there is no Node of version 20 or newer'
    exit 0
fi
if ! rustup target list --installed 2> /dev/null | grep -q '^wasm32-unknown-unknown$' &&
    ! rustup target add wasm32-unknown-unknown > /dev/null 2>&1; then
    say 'skipped: the toolchain has no library for wasm32-unknown-unknown'
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

say 'building'
wasm/build.sh
if [ -z "${SPINNEY:-}" ]; then
    cargo build --quiet --locked --features remote --bin spinney
    # (Others are built in its place meanwhile.)
    cp "$target/debug/spinney" "$work/"
    export SPINNEY=$work/spinney
fi
export SPINNEY_FILES=$work/files

say 'under Node'
# (The files are made once.)
node -e 'import("./wasm/test/helpers.mjs").then(({ files }) => files())'
node --test --test-reporter=dot wasm/test/*.test.mjs
say 'JavaScript package: all is well'
