#!/usr/bin/env bash
# Builds the JavaScript package, as npm takes it, into wasm/dist:
#
#     wasm/build.sh
#
# What it needs is `rustup target add wasm32-unknown-unknown`; Cargo gets the rest.
set -euo pipefail
cd "$(dirname "$0")"
target=${CARGO_TARGET_DIR:-target}
cargo build --quiet --locked --release --target wasm32-unknown-unknown -p spinney-wasm
cargo run --quiet --locked -p spinney-bindgen -- "$target/wasm32-unknown-unknown/release/spinney_wasm.wasm" "$target/glue"
rm -rf dist.new
mkdir dist.new
# (The folder is there from the beginning, so that what is compiled before knows where to look.)
touch dist.new/.gitkeep
cp js/*.js index.d.ts package.json README.md ../LICENSE-APACHE ../LICENSE-MIT "$target"/glue/module.js "$target"/glue/module_bg.wasm dist.new/
# (Somebody may be reading it: what is the same stays.)
if diff -rq dist.new dist > /dev/null 2>&1; then
    rm -rf dist.new
else
    rm -rf dist.old
    [ ! -e dist ] || mv dist dist.old
    mv dist.new dist
    rm -rf dist.old
fi
