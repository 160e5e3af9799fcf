// Random windows through GDAL: windows per second of processor time, the median of passes. For
// gdal_driver.py.
//
//     gdal_driver FILE aligned|anywhere SIDE OUT_SIDE warm|cold all|band
//
// Warm passes read the same windows again, so that decoded blocks are in GDAL's cache. Cold passes
// start with an empty cache.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <random>
#include <string>
#include <vector>

#include "gdal_priv.h"

namespace {

double processor_time() {
  timespec time;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

} // namespace

int main(int argc, char **argv) {
  if (argc != 7) {
    return 2;
  }
  GDALAllRegister();
  GDALDatasetUniquePtr raster(GDALDataset::Open(argv[1]));
  if (raster == nullptr) {
    return 1;
  }
  const bool aligned = std::string(argv[2]) == "aligned", warm = std::string(argv[5]) == "warm";
  const int side = std::atoi(argv[3]), out = std::atoi(argv[4]);
  const int bands = std::string(argv[6]) == "all" ? raster->GetRasterCount() : 1;
  const GDALDataType type = raster->GetRasterBand(1)->GetRasterDataType();
  std::mt19937 random(3);
  const auto below = [&](int most) { return static_cast<int>(random() % static_cast<unsigned>(most)); };
  std::vector<std::pair<int, int>> positions(400);
  for (auto &[x, y] : positions) {
    x = below(raster->GetRasterXSize() - side + 1);
    y = below(raster->GetRasterYSize() - side + 1);
    if (aligned) {
      x = x / 256 * 256;
      y = y / 256 * 256;
    }
  }
  const size_t samples = static_cast<size_t>(out) * static_cast<size_t>(out) * static_cast<size_t>(bands);
  std::vector<char> buffer(samples * static_cast<size_t>(GDALGetDataTypeSizeBytes(type)));
  std::vector<double> rates;
  for (int turn = 0; turn < 6; ++turn) {
    if (!warm) {
      raster->FlushCache();
    }
    const double start = processor_time();
    for (const auto &[x, y] : positions) {
      if (raster->RasterIO(GF_Read, x, y, side, side, buffer.data(), out, out, type, bands, nullptr, 0, 0, 0, nullptr) != CE_None) {
        return 1;
      }
    }
    if (turn > 0) {
      rates.push_back(static_cast<double>(positions.size()) / (processor_time() - start));
    }
  }
  std::sort(rates.begin(), rates.end());
  std::printf("%.0f\n", rates[rates.size() / 2]);
}
