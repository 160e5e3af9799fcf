#!/usr/bin/env bash
# Builds the C library and installs it with its header and its pkg-config file:
#
#     capi/install.sh PREFIX
#
# PROFILE=dev FEATURES=program installs the library with the profile and features of the tests.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
prefix=${1:?usage: capi/install.sh PREFIX}
profile=${PROFILE:-release}
cargo build --locked --manifest-path "$here/Cargo.toml" --profile "$profile" ${FEATURES:+--features "$FEATURES"}
target=${CARGO_TARGET_DIR:-$here/../target}
built=$target/${profile/#dev/debug}
mkdir -p "$prefix/lib/pkgconfig" "$prefix/include"
prefix=$(cd "$prefix" && pwd)
install -m 644 "$built/libspinney.a" "$prefix/lib"
install -m 644 "$here/include/spinney.h" "$prefix/include"
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../Cargo.toml" | head -1)
# The file name has the version. Programs load the library by its ABI (the soname), linkers by the
# name without a number.
install -m 755 "$built/libspinney.so" "$prefix/lib/libspinney.so.$version"
ln -sf "libspinney.so.$version" "$prefix/lib/libspinney.so.${version%%.*}"
ln -sf "libspinney.so.${version%%.*}" "$prefix/lib/libspinney.so"
# Most of the size is debug symbols.
strip --strip-unneeded "$prefix/lib/libspinney.so.$version"
strip --strip-debug "$prefix/lib/libspinney.a"
sed "s#@PREFIX@#$prefix#; s#@VERSION@#$version#" "$here/spinney.pc.in" > "$prefix/lib/pkgconfig/spinney.pc"
echo "$prefix: lib/libspinney.so, lib/libspinney.a, include/spinney.h, lib/pkgconfig/spinney.pc"
