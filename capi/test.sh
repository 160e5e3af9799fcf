#!/usr/bin/env bash
# Tests the C interface as C and C++ programs, pkg-config and GDAL use it:
#
#     capi/test.sh
#
# Installs GDAL and its headers if they are missing (from the package sources of Debian or Ubuntu).
# Where that is impossible, a message says that the driver is not tested.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
say() { printf -- '-- %s\n' "$*"; }
fail() {
    echo "capi/test.sh: $*" >&2
    exit 1
}
# Installs system packages, one script at a time. Updates the package lists if the first try fails.
install() {
    flock Cargo.toml apt-get install -y -qq "$@" > /dev/null 2>&1 ||
        { flock Cargo.toml apt-get update -qq > /dev/null 2>&1 && flock Cargo.toml apt-get install -y -qq "$@" > /dev/null 2>&1; }
}
fixtures=fixtures/v1

say 'the header is the one that cbindgen makes'
CARGO_TARGET_DIR=$target cargo run --quiet --locked --manifest-path capi/header/Cargo.toml > "$work/spinney.h"
diff -u capi/include/spinney.h "$work/spinney.h" || fail 'capi/include/spinney.h differs from the sources'

say 'installing'
PROFILE=dev FEATURES=program CARGO_TARGET_DIR=$target capi/install.sh "$work/prefix" > /dev/null
cargo build --quiet --locked --features remote --bin spinney
spinney=$target/debug/spinney
export PKG_CONFIG_PATH=$work/prefix/lib/pkgconfig LD_LIBRARY_PATH=$work/prefix/lib
command -v pkg-config > /dev/null || install pkg-config || fail 'pkg-config is needed'
read -ra flags <<< "$(pkg-config --cflags --libs spinney)"

readelf -d "$work/prefix/lib/libspinney.so" | grep -q 'SONAME.*\[libspinney\.so\.0\]' || fail 'the library has no ABI in its name'

say 'C11 and C++17, without a warning, under AddressSanitizer'
strict=(-Wall -Wextra -Werror -pedantic -g -fsanitize=address,undefined)
${CC:-cc} -std=c11 "${strict[@]}" capi/examples/tile.c -o "$work/tile" "${flags[@]}"
${CC:-cc} -std=c11 "${strict[@]}" capi/examples/body.c -o "$work/body" "${flags[@]}"
${CC:-cc} -std=c11 "${strict[@]}" capi/examples/cube.c -o "$work/cube" "${flags[@]}"
${CC:-cc} -std=c11 "${strict[@]}" capi/examples/layers.c -o "$work/layers" "${flags[@]}"
${CXX:-c++} -std=c++17 "${strict[@]}" capi/examples/levels.cpp -o "$work/levels" "${flags[@]}"
# The header alone, in both languages.
for language in c c++; do
    echo '#include "spinney.h"' | ${CC:-cc} -x $language -Wall -Wextra -Werror -pedantic -fsyntax-only "${flags[@]}" -
done

say 'the program in docs/c.md'
awk '/^```c$/ { inside = 1; next } /^```$/ { inside = 0 } inside' docs/c.md > "$work/page.c"
${CC:-cc} -std=c11 "${strict[@]}" "$work/page.c" -o "$work/page" "${flags[@]}"
"$work/page" | grep -qE '^[0-9.]+ [0-9.]+$' || fail 'the program in docs/c.md prints no numbers'

say 'a tile is that of the program'
"$work/tile" $fixtures/classes.goblin 6 3 5 40 30 > "$work/tile.pgm" 2> /dev/null
"$spinney" get -q $fixtures/classes.goblin "$work/tile.raw" --level 6 --window 12,20,160,120
tail -c 1200 "$work/tile.pgm" | cmp - "$work/tile.raw"

say 'levels of files of all kinds'
model=$fixtures/chapel.goblin
for file in $(ls $fixtures/*.goblin | grep -v -e /chapel -e /crossing) "$fixtures/history.autumn" "$fixtures/history.autumn@1"; do
    "$work/levels" "$file" > "$work/levels.txt"
    grep -q '^exactly' "$work/levels.txt" || fail "$file: no levels"
done
for file in missing.goblin capi/test.sh "$fixtures/history.autumn@77" "$model"; do
    if "$work/levels" "$file" 2> "$work/error.txt"; then fail "$file: opened"; fi
    grep -q '^levels: .*' "$work/error.txt" || fail "$file: no message"
done

say 'layers are those of the program'
for file in $fixtures/stack.goblin $fixtures/stack.autumn $fixtures/stack.autumn@1; do
    "$work/layers" "$file" > "$work/layers.txt"
    "$spinney" info --json "$file" > "$work/layers.json"
    python3 - "$work" "$spinney" "$file" << 'END'
import json, subprocess, sys
work, spinney, file = sys.argv[1:]
layers = json.load(open(f"{work}/layers.json"))["layers"]
found = [line.split() for line in open(f"{work}/layers.txt")]
assert [(line[1], int(line[2])) for line in found] == [(layer["layer"], layer["depth"]) for layer in layers], found
for number, (line, layer) in enumerate(zip(found, layers)):
    stats = json.loads(subprocess.check_output([spinney, "stats", "--json", f"{file}:{layer['layer']}"]))
    assert int(line[0]) == number and float(line[3]) == stats["channels"][0]["mean"], (line, stats)
END
done
"$work/levels" $fixtures/stack.goblin:height | grep -q '^level 6: 64 x 50' || fail 'no layer by its path'
if "$work/levels" $fixtures/stack.goblin:depth 2> "$work/error.txt"; then fail 'a missing layer was opened'; fi
grep -q '`height`' "$work/error.txt" || fail 'no names of layers'

say 'an exact model says what the program says'
"$work/body" $model > "$work/body.txt"
"$spinney" stats --json $model > "$work/body.json"
python3 - "$work/body.txt" "$work/body.json" << 'END'
import json, sys
found, stats = open(sys.argv[1]).read().split(), json.load(open(sys.argv[2]))
assert [float(found[1]), float(found[3])] == [stats["volume"], stats["surface"]], (found, stats)
assert found[5] == "inside" and float(found[7]) < 0, found
END
for file in missing.goblin $fixtures/ball.goblin; do
    if "$work/body" "$file" 2> "$work/error.txt"; then fail "$file: opened as an exact model"; fi
    grep -q '^body: .*' "$work/error.txt" || fail "$file: no message"
done

say 'an exact model of arrays is that of a file'
printf 'OFF\n8 6 0\n0 0 0\n2 0 0\n0 2 0\n2 2 0\n0 0 2\n2 0 2\n0 2 2\n2 2 2\n4 0 2 3 1\n4 4 5 7 6\n4 0 1 5 4\n4 2 6 7 3\n4 0 4 6 2\n4 1 3 7 5\n' > "$work/cube.off"
"$spinney" build -q "$work/cube.off" -o "$work/cube.goblin" --brep
"$work/cube" "$work/made.goblin" > "$work/cube.txt"
diff - "$work/cube.txt" << 'END' || fail 'other numbers of a cube'
volume 8
ring 0 of polygon 0: 9 points, area 4
END
"$spinney" verify -q "$work/made.goblin"
"$spinney" combine -q xor "$work/made.goblin" "$work/cube.goblin" -o "$work/nothing.goblin"
"$spinney" stats --json "$work/nothing.goblin" | grep -q '"volume": *0.0*[,}]' || fail 'a cube from arrays differs from that of a file'
if "$work/cube" "$work/open.goblin" open 2> "$work/error.txt"; then fail 'an open surface was taken for a body'; fi
grep -q 'a boundary of 3 edges from' "$work/error.txt" || fail 'no positions of an open surface'
[ ! -e "$work/open.goblin" ] || fail 'a surface that is not a solid left a file'
"$work/cube" "$work/twice.goblin" twice > "$work/cube.txt" 2> "$work/error.txt"
grep -q '^volume 8$' "$work/cube.txt" || fail 'two cubes without what is in both have another volume'
grep -q '^cube: .*: the volume differs by .* percent from that of cells' "$work/error.txt" || fail 'no warning of a changed volume'
"$work/cube" "$work/made.goblin" 2>&1 | grep -q '^cube: ' && fail 'a warning of a cube'

say 'statically'
${CC:-cc} -std=c11 capi/examples/tile.c -I"$work/prefix/include" -o "$work/static" "$work/prefix/lib/libspinney.a" -lpthread -ldl -lm
"$work/static" $fixtures/classes.goblin 6 3 5 40 30 2> /dev/null | cmp - "$work/tile.pgm"

say 'GDAL'
if ! command -v gdalinfo > /dev/null && ! install gdal-bin; then
    say 'skipped: GDAL is missing, and cannot be installed'
    exit 0
fi
if ! command -v gdal-config > /dev/null && ! install libgdal-dev; then
    # Only the headers, if the dependencies of the package cannot be installed.
    headers=$(realpath "$target")/gdal-headers
    mkdir -p "$headers"
    if [ ! -d "$headers/usr/include/gdal" ] &&
        ! (cd "$headers" && apt-get download -qq libgdal-dev && dpkg -x libgdal-dev_*.deb .) > /dev/null 2>&1; then
        say 'skipped: the headers of GDAL are not there, and cannot be had'
        exit 0
    fi
    export GDAL_CFLAGS=-I$headers/usr/include/gdal
    GDAL_LIBS=$(ldconfig -p | sed -n 's/.*libgdal\.so\.[0-9]* .* => //p' | head -1)
    export GDAL_LIBS
fi
capi/gdal/build.sh "$work/prefix" > /dev/null
export GDAL_DRIVER_PATH=$work/prefix/lib/gdalplugins
[[ $(gdalinfo --formats) == *Spinney* ]] || fail 'GDAL does not know the driver'
raw() { gdal_translate -q -of ENVI "$@"; }
# Files in GDAL's virtual file systems: on servers, in archives, in memory.
python3 tests/servers/ranges.py $fixtures > "$work/url" &
server=$!
trap 'kill $server; rm -rf "$work"' EXIT
while [ ! -s "$work/url" ]; do sleep 0.1; done
url=/vsicurl/$(cat "$work/url")
for name in classes.goblin stack.goblin stack.goblin:height history.autumn@1; do
    raw "$fixtures/$name" "$work/near.img"
    raw "$url/$name" "$work/far.img"
    cmp "$work/near.img" "$work/far.img" || fail "$name: other samples from a server through GDAL"
done
if gdalinfo "$url/missing.goblin" > /dev/null 2>&1; then fail 'a missing file was opened'; fi
for name in classes elevation rgb; do
    "$spinney" get -q $fixtures/$name.goblin "$work/$name.tif"
    raw $fixtures/$name.goblin "$work/ours.img"
    raw "$work/$name.tif" "$work/theirs.img"
    cmp "$work/ours.img" "$work/theirs.img" || fail "$name: other samples through GDAL"
    # A window, and an overview.
    raw -srcwin 5 7 31 23 $fixtures/$name.goblin "$work/ours.img"
    raw -srcwin 5 7 31 23 "$work/$name.tif" "$work/theirs.img"
    cmp "$work/ours.img" "$work/theirs.img" || fail "$name: another window through GDAL"
    gdalinfo -json $fixtures/$name.goblin > "$work/$name.json"
done
python3 - "$work" "$spinney" << 'END'
import json, subprocess, sys
work, spinney = sys.argv[1:]
def found(name):
    with open(f"{work}/{name}.json") as file:
        ours = json.load(file)
    theirs = json.loads(subprocess.check_output(["gdalinfo", "-json", f"{work}/{name}.tif"]))
    stats = json.loads(subprocess.check_output([spinney, "stats", "--json", f"fixtures/v1/{name}.goblin"]))
    return ours, theirs, stats
for name in ["classes", "elevation", "rgb"]:
    ours, theirs, stats = found(name)
    assert ours["size"] == theirs["size"], name
    assert ours.get("geoTransform") == theirs.get("geoTransform"), name
    assert [band["type"] for band in ours["bands"]] == [band["type"] for band in theirs["bands"]], name
    assert [band.get("noDataValue") for band in ours["bands"]] == [band.get("noDataValue") for band in theirs["bands"]], name
    # (A TIFF file has 256 colours, used or not.)
    colours = lambda found: found["bands"][0].get("colorTable", {"entries": []})["entries"]
    assert colours(ours) == colours(theirs)[: len(colours(ours))], name
    assert bool(colours(ours)) == bool(colours(theirs)), name
    # (The name, and the number at the end: PROJ and GeoTIFF describe datums differently.)
    system = lambda found: [found.get("coordinateSystem", {}).get("wkt", "-").splitlines()[at] for at in [0, -1]]
    assert system(ours) == system(theirs), (name, system(ours), system(theirs))
    for band, known in zip(ours["bands"], stats["channels"]):
        told_mean = float(band["metadata"][""]["STATISTICS_MEAN"])
        assert abs(told_mean - known["mean"]) < 1e-9 * max(1.0, abs(known["mean"])), (name, told_mean, known)
    width, height = ours["size"]
    sizes = [overview["size"] for overview in ours["bands"][0].get("overviews", [])]
    expected = []
    while max(width, height) > 256:
        width, height = (width + 1) // 2, (height + 1) // 2
        expected.append([width, height])
    assert sizes == expected, (name, sizes, expected)
END
# Overviews are levels; the last one is no larger than a block. Windows have the same samples
# through the block cache and without it.
for name in elevation rgb; do
    gdal_translate -q -outsize 1100 700 -r bilinear "$work/$name.tif" "$work/large.tif"
    "$spinney" build -q "$work/large.tif" -o "$work/large.goblin"
    overviews=$(gdalinfo -json "$work/large.goblin" | python3 -c 'import json, sys; print([each["size"] for each in json.load(sys.stdin)["bands"][0]["overviews"]])')
    [ "$overviews" = '[[550, 350], [275, 175], [138, 88]]' ] || fail "$name: other overviews: $overviews"
    level=$(("$("$spinney" info --json "$work/large.goblin" | python3 -c 'import json, sys; print(json.load(sys.stdin)["depth"])')" - 2))
    "$spinney" get -q "$work/large.goblin" "$work/level.tif" --level "$level"
    raw -outsize 275 175 "$work/large.goblin" "$work/ours.img"
    raw "$work/level.tif" "$work/theirs.img"
    cmp "$work/ours.img" "$work/theirs.img" || fail "$name: a level is not the overview of GDAL"
    for cache in 0 1 64; do
        for window in '0 0 1100 700' '3 250 1090 300' '256 256 256 256' '255 511 3 2' '1000 600 100 100'; do
            # shellcheck disable=SC2086 # four numbers
            raw --config GDAL_CACHEMAX $cache -srcwin $window "$work/large.goblin" "$work/ours.img"
            # shellcheck disable=SC2086
            raw -srcwin $window "$work/large.tif" "$work/theirs.img"
            cmp "$work/ours.img" "$work/theirs.img" || fail "$name: another window $window through GDAL with a cache of $cache"
        done
    done
    # Histograms, also approximate ones, and extremes are exact.
    for picture in large.goblin large.tif; do
        gdalinfo -json -hist -mm --config GDAL_PAM_ENABLED NO "$work/$picture" > "$work/$picture.json"
    done
    "$spinney" stats --json "$work/large.goblin" > "$work/large.json"
    python3 - "$work" << 'END'
import json, sys
channels = json.load(open(f"{sys.argv[1]}/large.json"))["channels"]
ours, theirs = (json.load(open(f"{sys.argv[1]}/large.{ending}.json"))["bands"] for ending in ["goblin", "tif"])
for band, (own, other) in enumerate(zip(ours, theirs)):
    cells = sum(own["histogram"]["buckets"])
    assert (own["computedMin"], own["computedMax"]) == (other["computedMin"], other["computedMax"]), (band, own, other)
    if own["type"] == "Byte":
        assert own["histogram"]["buckets"] == other["histogram"]["buckets"], band
    # (GDAL computes approximate statistics from an overview, or from some blocks.)
    assert cells == channels[band]["cells"], (band, cells)
END
done
# GDAL gets coordinate systems without an EPSG code.
for definition in '+proj=laea +lat_0=45 +lon_0=-100 +R=6370997' \
    '+proj=tmerc +lat_0=0 +lon_0=9.5 +k=0.9999 +x_0=123456 +ellps=bessel +towgs84=598,73,418,0.2,0.045,-2.4,6.7' \
    '+proj=stere +lat_0=-90 +lat_ts=-70 +a=6378273 +rf=298.279411123064'; do
    "$spinney" build -q "$work/elevation.tif" -o "$work/own.goblin" --crs "$definition" 2> /dev/null
    place() { echo '10 50' | gdaltransform -s_srs EPSG:4326 -t_srs "$1"; }
    found=$(gdalinfo -json "$work/own.goblin" | python3 -c 'import json, sys; print(json.load(sys.stdin)["coordinateSystem"]["wkt"])')
    [ "$(place "$found")" = "$(place "$definition")" ] || fail "$definition: another coordinate system through GDAL: $found"
done
# An unknown definition is reported.
"$spinney" build -q "$work/elevation.tif" -o "$work/own.goblin" --crs '{"type":"OtherCRS","name":"a yard"}' 2> /dev/null
gdalinfo "$work/own.goblin" > "$work/own.txt" 2>&1
grep -q 'SPINNEY_CRS=.*a yard' "$work/own.txt" || fail 'no definition through GDAL'
grep -q 'Warning.*SPINNEY_CRS' "$work/own.txt" || fail 'no warning through GDAL'
[[ $(gdalinfo "$fixtures/history.autumn@1") == *SPINNEY_COMMIT=1* ]] || fail 'no commit through GDAL'
# VOID cells are masked if there is no nodata number.
"$spinney" transform -q $fixtures/rgb.goblin rotate=30 -o "$work/turned.goblin"
[[ $(gdalinfo "$work/turned.goblin") == *PER_DATASET* ]] || fail 'no mask through GDAL'
raw -b mask "$work/turned.goblin" "$work/mask.img"
cells=$("$spinney" stats --json "$work/turned.goblin" | python3 -c 'import json, sys; print(json.load(sys.stdin)["cells"])')
[ "$(tr -dc '\377' < "$work/mask.img" | wc -c)" = "$cells" ] || fail 'another mask through GDAL'
# Layers: all layers of a file, on the cells of the finest, also where its border cuts larger cells,
# and outside of a layer.
place() { gdal_translate -q -a_srs EPSG:32628 "$@"; }
place -outsize 601 403 -r bilinear -a_ullr 0 403 601 0 "$work/elevation.tif" "$work/fine.tif"
place -outsize 301 202 -a_ullr 0 403 602 -1 "$work/rgb.tif" "$work/half.tif"
place -outsize 76 51 -a_ullr 0 403 608 -5 "$work/classes.tif" "$work/eighth.tif"
place -srcwin 0 0 50 40 -a_ullr 0 403 50 363 "$work/rgb.tif" "$work/part.tif"
"$spinney" build -q "$work/eighth.tif" "$work/fine.tif" "$work/half.tif" --names 'class,height,colour: all' --stack -o "$work/layers.goblin"
"$spinney" build -q "$work/part.tif" -o "$work/part.goblin"
"$spinney" edit -q "$work/layers.goblin" add-layer "$work/part.goblin"
"$spinney" convert -q "$work/layers.goblin" -o "$work/layers.autumn"
python3 capi/gdal/layers.py "$spinney" "$work" $fixtures/stack.goblin $fixtures/stack.autumn "$work/layers.goblin" "$work/layers.autumn"
[[ $(gdalinfo "$fixtures/stack.autumn@1") == *"stack.autumn@1:label"* ]] || fail 'no layers of a commit through GDAL'
gdalinfo "$fixtures/stack.autumn@1:label" > /dev/null || fail 'no layer of a commit through GDAL'
# Bands of several types at once, through the cache and without it.
for cache in 0 64; do
    for bands in '-b 2 -b 1' '-b 3 -b 4 -b 2 -b 5 -b 5 -b 1'; do
        # shellcheck disable=SC2086 # several words
        raw --config GDAL_CACHEMAX $cache -ot Float64 $bands "$work/layers.goblin" "$work/ours.img"
        : > "$work/theirs.img"
        for band in ${bands//-b/}; do
            raw -ot Float64 -b "$band" "$work/layers.goblin" "$work/band.img"
            cat "$work/band.img" >> "$work/theirs.img"
        done
        cmp "$work/ours.img" "$work/theirs.img" || fail "bands $bands: other samples than one by one through GDAL with a cache of $cache"
    done
done
for file in $fixtures/ball.goblin "$fixtures/history.autumn@77" "$fixtures/stack.goblin:depth" "$fixtures/classes.goblin:1"; do
    if gdalinfo "$file" > /dev/null 2>&1; then fail "$file: opened by GDAL"; fi
done
say 'C interface: all is well'
