#!/usr/bin/env bash
# Builds the WebAssembly module of the JavaScript package, which is committed:
#
#     wasm/build.sh            # writes module.js, module_bg.wasm and module.sources to
#                              # crates/site/page/spinney
#     wasm/build.sh --check    # reports whether the sources differ from the committed module's
#
# The same sources and compiler give the same bytes in any directory. Rebuild in the last commit of
# a change to the module's sources. Building needs `rustup target add wasm32-unknown-unknown`; Cargo
# downloads the rest.
set -euo pipefail
cd "$(dirname "$0")"
package=../crates/site/page/spinney

# Digest of all sources that the module is built from: packages of the lock file without a `source`
# are path dependencies.
digest() {
    local name directories=(src bindgen)
    for name in $(awk -v RS= '/^\[\[package/ && !/\nsource = / { gsub(/"/, "", $4); print $4 }' Cargo.lock); do
        case $name in
        spinney-wasm | spinney-bindgen) ;;
        *) directories+=("../crates/${name#spinney-}") ;;
        esac
    done
    find "${directories[@]}" ../Cargo.toml Cargo.toml Cargo.lock -type f \
        ! -path '*/tests/*' ! -name 'tests.rs' -print0 |
        LC_ALL=C sort -z | xargs -0 sha256sum | sha256sum | cut -d ' ' -f 1
}

if [ "${1:-}" = --check ]; then
    if ! grep -qsx "sources $(digest)" "$package/module.sources"; then
        echo "-- note: sources of the browser module have changed since it was built: wasm/build.sh rebuilds it"
    fi
    exit 0
fi

# The module does not depend on the directories of the sources, of Cargo's files and of the standard
# library's sources.
commit=$(rustc -vV | sed -n 's/^commit-hash: //p')
SPINNEY_RUSTC_ARGUMENTS=$(printf -- '--remap-path-prefix=%s\n' "$(realpath ..)=/spinney" "${CARGO_HOME:-$HOME/.cargo}=/cargo" \
    "$(rustc --print sysroot)/lib/rustlib/src/rust=/rustc/$commit")
export SPINNEY_RUSTC_ARGUMENTS
target=${CARGO_TARGET_DIR:-target}
# (The user's flags do not apply. With 128-bit vectors packed segments are decoded three times as
# fast.)
CARGO_ENCODED_RUSTFLAGS='-Ctarget-feature=+simd128' RUSTC_WRAPPER=$PWD/rustc.sh \
    cargo build --quiet --locked --release --target wasm32-unknown-unknown -p spinney-wasm
cargo run --quiet --locked -p spinney-bindgen -- "$target/wasm32-unknown-unknown/release/spinney_wasm.wasm" "$target/glue"
cp "$target"/glue/module.js "$target"/glue/module_bg.wasm "$package/"
printf '%s\n' "sources $(digest)" "$(rustc --version)" \
    "wasm-bindgen $(sed -n 's/^wasm-bindgen = "=\(.*\)"/\1/p' Cargo.toml)" > "$package/module.sources"
