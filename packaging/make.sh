#!/usr/bin/env bash
# Makes the packages of a release:
#
#     packaging/make.sh DIRECTORY [program] [wheel] [c] [npm]
#
# - program: spinney-VERSION-SYSTEM.tar.gz: the program, completions, README, docs, licences;
# - wheel: the Python package, for Python 3.11 and later (manylinux if its linker is available);
# - c: libspinney-VERSION-SYSTEM.tar.gz: the C library, header and pkg-config file (Linux);
# - npm: spinney-VERSION.tgz, the JavaScript package.
#
# Makes all of them if none is named. PROFILE is Cargo's profile (default: release). FEATURES are
# additional features of the C library (`program` reuses the build of the program).
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -ge 1 ] || { sed -n '2,13s/^# \{0,1\}//p' "$0" >&2; exit 2; }
mkdir -p "$1"
out=$(realpath "$1")
shift
[ $# -gt 0 ] || set -- program wheel c npm
profile=${PROFILE:-release}
target=${CARGO_TARGET_DIR:-$PWD/target}
built=$target/${profile/#dev/debug}
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
system=$(rustc -vV | sed -n 's/^host: //p')
# (Windows has another extension of programs and another directory in Python environments. On macOS,
# GNU tar is gtar.)
exe='' bin=bin
[[ $system != *windows* ]] || exe=.exe bin=Scripts
tar=$(command -v gtar || echo tar)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Packs a directory of $work. Equal files give equal bytes.
pack() {
    "$tar" --sort=name --owner=0 --group=0 --numeric-owner --mtime='2000-01-01 00:00Z' -C "$work" -c "$1" | gzip -n > "$out/$1.tar.gz"
    echo "$out/$1.tar.gz"
}

# A release contains the browser module built from the same sources.
browser() {
    [ "$profile" = release ] || return 0
    if rustup target add wasm32-unknown-unknown > /dev/null 2>&1; then
        wasm/build.sh
    else
        echo "$0: with the committed browser module: the toolchain has no library for wasm32-unknown-unknown" >&2
    fi
}

program() {
    local name=spinney-$version-$system
    cargo build --quiet --locked --profile "$profile" --features remote --bin spinney
    mkdir -p "$work/$name/completions"
    cp "$built/spinney$exe" README.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT LICENSE-DEJAVU "$work/$name/"
    cp -r docs "$work/$name/docs"
    [ -n "$exe" ] || strip "$work/$name/spinney"
    for shell in bash zsh fish; do
        "$built/spinney$exe" completions $shell > "$work/$name/completions/spinney.$shell"
    done
    pack "$name"
}

wheel() {
    local python=${PYTHON:-python3} maker=("$work/venv/$bin/maturin")
    "$python" -m venv "$work/venv"
    "$work/venv/$bin/pip" install --quiet --disable-pip-version-check 'maturin>=1.9.4,<2'
    # zig, a package as well, links wheels for systems older than this one.
    local how=()
    if [ "$profile" = release ] && [[ $system == *linux* ]] && "$work/venv/$bin/pip" install --quiet --disable-pip-version-check ziglang; then
        how=(--zig --compatibility manylinux2014)
    fi
    PATH=$work/venv/$bin:$PATH "${maker[@]}" build --quiet --manifest-path python/Cargo.toml --profile "$profile" --locked \
        ${how[@]+"${how[@]}"} --out "$work/wheels" --interpreter "$work/venv/$bin/python"
    cp "$work"/wheels/*.whl "$out/"
    ls "$out"/*.whl
}

c() {
    local name=libspinney-$version-$system
    PROFILE=$profile CARGO_TARGET_DIR=$target capi/install.sh "$work/$name" > /dev/null
    # (It may be unpacked anywhere.)
    sed -i 's#^prefix=.*#prefix=${pcfiledir}/../..#' "$work/$name/lib/pkgconfig/spinney.pc"
    cp LICENSE-APACHE LICENSE-MIT LICENSE-DEJAVU docs/c.md "$work/$name/"
    pack "$name"
}

javascript() {
    (cd crates/site/page/spinney && npm pack --silent --pack-destination "$out")
}

browser
for part in "$@"; do
    case $part in
    program | wheel | c) $part ;;
    npm) javascript ;;
    *) echo "$0: $part: expected program, wheel, c or npm" >&2; exit 2 ;;
    esac
done
