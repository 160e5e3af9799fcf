#!/usr/bin/env bash
# Makes the packages of a release, installs each in an empty directory and uses it:
#
#     packaging/test.sh
#
# Builds them with the profile of the tests (PROFILE=release: with that of releases). Also checks
# the contents of the npm package, and prints the size of each package.
set -euo pipefail
cd "$(dirname "$0")/.."
export PROFILE=${PROFILE:-dev}
[ "$PROFILE" != dev ] || export FEATURES=program
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fixtures=$PWD/fixtures
packaging/make.sh "$work" program wheel c
du --bytes "$work"/*.whl "$work"/*.tar.gz | awk '{ sub(/.*\//, "", $2); printf "%s: %.1f MB (profile '"$PROFILE"')\n", $2, $1 / 1e6 }'
packaging/crates.sh
if ! command -v npm > /dev/null; then
    echo 'skipped: the npm package, without npm'
else
    (cd crates/site/page/spinney && npm pack --dry-run) > "$work/npm.txt" 2>&1
    grep -q ' module_bg\.wasm$' "$work/npm.txt"
    sed -n 's/^npm notice package size: /npm: /p' "$work/npm.txt"
fi

mkdir "$work/program" "$work/c"
tar -xzf "$work"/spinney-*.tar.gz -C "$work/program" --strip-components=1
"$work/program/spinney" point --in cells "$fixtures/v1/classes.goblin" 20,20 > "$work/point.txt"
grep -q . "$work/point.txt"
test -s "$work/program/completions/spinney.bash"
"$work/program/spinney" export -q "$fixtures/v1/classes.goblin" "$work/site/index.html"
cmp "$work/site/assets/spinney/module_bg.wasm" crates/site/page/spinney/module_bg.wasm

tar -xzf "$work"/libspinney-*.tar.gz -C "$work/c" --strip-components=1
# The soname has the number of the ABI, and the library has no symbols for debuggers.
readelf -d "$work/c/lib/libspinney.so" | grep -q 'SONAME.*\[libspinney\.so\.[0-9]*\]'
test -e "$work/c/lib/$(readelf -d "$work/c/lib/libspinney.so" | sed -n 's/.*SONAME.*\[\(.*\)\]/\1/p')"
! readelf -S "$work/c/lib/libspinney.so" | grep -qE '\.(symtab|debug_info)'
if command -v pkg-config > /dev/null; then
    read -ra flags <<< "$(PKG_CONFIG_PATH=$work/c/lib/pkgconfig pkg-config --cflags --libs spinney)"
    ${CC:-cc} -std=c11 capi/examples/tile.c -o "$work/tile" "${flags[@]}"
    LD_LIBRARY_PATH=$work/c/lib "$work/tile" "$fixtures/v1/classes.goblin" 6 3 5 40 30 2> /dev/null | head -c 2 | grep -q P5
fi

"${PYTHON:-python3}" -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "$work"/spinney-*.whl
cd "$work"
"$work/venv/bin/python" - "$fixtures/v1/classes.goblin" << 'END'
import sys
import spinney
tree = spinney.open(sys.argv[1])
print("the wheel answers:", tree, tree.stats().cells, "cells")
# Formats that need other libraries; and progress without tqdm, which is not installed here.
for ending in ("gpkg", "fgb"):
    tree.export(f"regions.{ending}", polygons=True, progress=True)
    assert spinney.combine("union", [f"regions.{ending}"], f"union.{ending}").features
for name in ("map.pmtiles", "map.mbtiles"):
    assert tree.export(name, zoom=(0, 4))
print("a page of it:", tree.export("page.html", self_contained=True), "file")
END
echo 'packages: all is well'
