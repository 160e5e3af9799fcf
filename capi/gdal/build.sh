#!/usr/bin/env bash
# Builds the GDAL driver against the system's GDAL and an installed libspinney:
#
#     capi/gdal/build.sh PREFIX
#
# PREFIX is that of capi/install.sh. GDAL finds the driver if GDAL_DRIVER_PATH is
# PREFIX/lib/gdalplugins. GDAL_CFLAGS and GDAL_LIBS override the output of gdal-config.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
prefix=$(cd "${1:?usage: capi/gdal/build.sh PREFIX}" && pwd)
cflags=${GDAL_CFLAGS:-$(gdal-config --cflags)}
libs=${GDAL_LIBS:-$(gdal-config --libs)}
mkdir -p "$prefix/lib/gdalplugins"
# shellcheck disable=SC2086 # these are several words
"${CXX:-c++}" -std=c++17 -O2 -s -Wall -Wextra -Werror -fPIC -shared -I"$prefix/include" $cflags \
    "$here/gdal_spinney.cpp" -o "$prefix/lib/gdalplugins/gdal_Spinney.so" \
    -L"$prefix/lib" -lspinney -Wl,-rpath,"$prefix/lib" $libs
echo "$prefix/lib/gdalplugins/gdal_Spinney.so"
