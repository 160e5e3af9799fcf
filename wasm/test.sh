#!/usr/bin/env bash
# Tests the JavaScript package, with its committed module, under Node against the program's results:
#
#     wasm/test.sh [--build]
#
# --build builds the module first. Without it, the library is only checked to compile for
# WebAssembly. SPINNEY names the program, which is built if it is not given. Skipped, with a
# message, without Node of version 20 or newer; the check is skipped without the library for
# wasm32-unknown-unknown.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
say() { printf -- '-- %s\n' "$*"; }
case ${1:-} in
--build) wasm/build.sh ;;
'')
    wasm/build.sh --check
    if rustup target add wasm32-unknown-unknown > /dev/null 2>&1; then
        say 'does it compile for WebAssembly?'
        (cd wasm && cargo check --quiet --locked --target wasm32-unknown-unknown -p spinney-wasm)
    else
        say 'skipped: does it compile for WebAssembly? the toolchain has no library for wasm32-unknown-unknown'
    fi
    ;;
*) echo "$0: $1: expected --build or nothing" >&2; exit 2 ;;
esac
if ! [[ $(node --version 2> /dev/null) =~ ^v(2[0-9]|[3-9][0-9])\. ]]; then
    say 'skipped: there is no Node of version 20 or newer'
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if [ -z "${SPINNEY:-}" ]; then
    cargo build --quiet --locked --features remote --bin spinney
    # (A copy, since other builds may replace the program meanwhile.)
    cp "$target/debug/spinney" "$work/"
    export SPINNEY=$work/spinney
fi
export SPINNEY_FILES=$work/files

say 'under Node'
# (The files are made once.)
node -e 'import("./wasm/test/helpers.mjs").then(({ files }) => files())'
node --test --test-reporter=dot wasm/test/*.test.mjs
say 'JavaScript package: all is well'
