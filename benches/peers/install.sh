#!/bin/sh
# Installs the peers: GDAL, libvips, rasterio.
set -e
apt-get install -y gdal-bin libvips-tools time
pip install rasterio numpy
