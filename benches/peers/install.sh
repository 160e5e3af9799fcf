#!/bin/sh
# Installs the peers: GDAL, libvips, rasterio, TensorStore, OpenVDB.
set -e
apt-get install -y gdal-bin libvips-tools libopenvdb-dev libboost-dev libtbb-dev g++ time
pip install rasterio numpy tensorstore
