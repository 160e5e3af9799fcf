// The layers of a Spinney file on the cells of the finest layer: their statistics, and windows of
// their samples.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "gdal_priv.h"
#include "spinney.h"

namespace {

void report() { CPLError(CE_Failure, CPLE_AppDefined, "%s", spinney_error()); }

// Allocates bytes; null, with GDAL's error, if there is no memory.
std::unique_ptr<GByte[]> allocate(size_t bytes) {
  std::unique_ptr<GByte[]> bytes_there(new (std::nothrow) GByte[bytes]);
  if (bytes_there == nullptr) {
    CPLError(CE_Failure, CPLE_OutOfMemory, "no memory for %llu bytes", static_cast<unsigned long long>(bytes));
  }
  return bytes_there;
}

// Cells of a level.
struct Window {
  int x, y, width, height;

  size_t cells() const { return static_cast<size_t>(width) * static_cast<size_t>(height); }
};

struct Close {
  void operator()(spinney_dataset *file) const { spinney_close(file); }
};
using Handle = std::unique_ptr<spinney_dataset, Close>;

// A layer, and what all of its levels share.
struct Layer {
  Handle handle;
  std::string name;
  spinney_info info{};
  // Statistics of the raster's cells.
  spinney_statistics statistics{};

  // The raster's depth minus the layer's: the layer's cells are 2^shift times as wide as the
  // raster's.
  uint32_t shift = 0;
  // The number of its first band, from 1.
  int first_band = 1;

  // The nodata number as a sample, if the sample type can hold it.
  bool has_nodata_sample = false;
  GByte nodata_sample[8] = {};

  template <typename T> T nodata_as() const {
    T number = 0;
    std::memcpy(&number, nodata_sample, sizeof number);
    return number;
  }

  int channels() const { return static_cast<int>(info.channels); }
  size_t sample_size() const { return info.cell_size / info.channels; }
  bool has_band(int band) const { return band >= first_band && band < first_band + channels(); }

  // Extremes of the first channel, if it has 64-bit integers.
  GByte minimum[8] = {}, maximum[8] = {};

  // Formats an extreme exactly.
  std::string extreme(const GByte *sample, double nearest) const {
    if (info.sample == SPINNEY_U64) {
      uint64_t number;
      std::memcpy(&number, sample, sizeof number);
      return std::to_string(number);
    }
    if (info.sample == SPINNEY_I64) {
      int64_t number;
      std::memcpy(&number, sample, sizeof number);
      return std::to_string(number);
    }
    return CPLSPrintf("%.17g", nearest);
  }

  // Whether the layer has a cell for every cell of the raster.
  bool is_everywhere = true;
  bool has_mask() const {
    return !info.has_nodata && info.alpha < 0 && (statistics.void_cells > 0 || !is_everywhere);
  }

  // Cells of the layer, and the number of raster cells that each of them covers. The raster may cut
  // cells in the last column or row.
  struct WeightedBox {
    spinney_box cells;
    uint64_t weight;
  };
  std::vector<WeightedBox> parts;

  // Reads the layer's properties from the handle.
  bool describe() {
    const size_t size = sizeof info;
    if (spinney_describe(handle.get(), &info, size) != SPINNEY_OK) {
      return false;
    }
    has_nodata_sample = spinney_nodata(handle.get(), nodata_sample, sample_size()) == SPINNEY_OK;
    const bool is_long = info.sample == SPINNEY_U64 || info.sample == SPINNEY_I64;
    return !is_long || spinney_extremes(handle.get(), nullptr, minimum, maximum, sizeof minimum) == SPINNEY_OK;
  }

  // Aligns the layer with a raster of the given depth and size in cells, and computes its
  // statistics.
  bool place(uint32_t depth, const uint64_t (&size)[2]) {
    shift = depth - info.depth;
    struct Span {
      uint64_t start, size, weight;
    };
    std::vector<Span> spans[2];
    for (int axis = 0; axis < 2; ++axis) {
      const uint64_t cells = info.size[axis], whole = std::min(cells, size[axis] >> shift);
      spans[axis].push_back({0, whole, 1ull << shift});
      if (whole < cells) {
        spans[axis].push_back({whole, 1, size[axis] - (whole << shift)});
      }
      is_everywhere = is_everywhere && cells << shift >= size[axis];
    }
    for (const Span &rows : spans[1]) {
      for (const Span &columns : spans[0]) {
        if (rows.size > 0 && columns.size > 0) {
          const spinney_box cells = {{columns.start, rows.start, 0}, {columns.size, rows.size, 1}};
          parts.push_back({cells, columns.weight * rows.weight});
        }
      }
    }
    return measure();
  }

  // Counts the raster's cells in equal intervals of a range.
  bool histogram(double low, double high, std::vector<uint64_t> &found) const {
    std::vector<uint64_t> counts(found.size());
    for (const WeightedBox &part : parts) {
      if (spinney_histogram(handle.get(), &part.cells, low, high, counts.data(), counts.size()) != SPINNEY_OK) {
        return false;
      }
      for (size_t i = 0; i < found.size(); ++i) {
        found[i] += counts[i] * part.weight;
      }
    }
    return true;
  }

private:
  bool measure() {
    if (parts.size() == 1 && parts[0].weight == 1) {
      return spinney_statistics_of(handle.get(), nullptr, &statistics) == SPINNEY_OK;
    }
    std::vector<spinney_statistics> found(parts.size());
    for (size_t i = 0; i < parts.size(); ++i) {
      if (spinney_statistics_of(handle.get(), &parts[i].cells, &found[i]) != SPINNEY_OK) {
        return false;
      }
      statistics.void_cells += found[i].void_cells * parts[i].weight;
    }
    for (int channel = 0; channel < channels(); ++channel) {
      spinney_channel_statistics &all = statistics.channels[channel];
      all.min = std::numeric_limits<double>::infinity();
      all.max = -all.min;
      for (size_t i = 0; i < parts.size(); ++i) {
        all.cells += found[i].channels[channel].cells * parts[i].weight;
      }
      const auto cells = static_cast<double>(all.cells);
      const auto each = [&](auto add) {
        for (size_t i = 0; i < parts.size(); ++i) {
          const spinney_channel_statistics &part = found[i].channels[channel];
          if (part.cells > 0) {
            add(part, static_cast<double>(part.cells) * static_cast<double>(parts[i].weight));
          }
        }
      };
      double square = 0.0;
      each([&](const spinney_channel_statistics &part, double) {
        all.min = std::min(all.min, part.min);
        all.max = std::max(all.max, part.max);
      });
      each([&](const spinney_channel_statistics &part, double weight) { all.mean += part.mean * (weight / cells); });
      each([&](const spinney_channel_statistics &part, double weight) {
        const double away = part.mean - all.mean;
        square += (part.standard_deviation * part.standard_deviation + away * away) * (weight / cells);
      });
      all.standard_deviation = std::sqrt(square);
    }
    return true;
  }
};

// The layers in GDAL's dataset: all of a file, or one.
struct Stack {
  std::vector<Layer> layers;
  // The first layer with the smallest cells, which are the raster's.
  size_t finest = 0;
  uint64_t size[2] = {0, 0};

  const Layer &reference() const { return layers[finest]; }
  uint32_t depth() const { return reference().info.depth; }

  // Size of a level, along x or y.
  int extent(int axis, uint32_t level) const {
    const uint32_t levels = depth() - level;
    return static_cast<int>((size[axis] >> levels) + ((size[axis] & ((1ull << levels) - 1)) != 0 ? 1 : 0));
  }

  // Aligns the layers with the cells of the finest. The raster has all cells of that layer, and
  // overlaps every cell of the others.
  bool place() {
    for (size_t i = 0; i < layers.size(); ++i) {
      finest = layers[i].info.depth > depth() ? i : finest;
    }
    int bands = 0;
    for (Layer &layer : layers) {
      layer.first_band = bands + 1;
      bands += layer.channels();
      for (int axis = 0; axis < 2; ++axis) {
        size[axis] = std::max(size[axis], ((layer.info.size[axis] - 1) << (depth() - layer.info.depth)) + 1);
      }
    }
    return std::all_of(layers.begin(), layers.end(), [&](Layer &layer) { return layer.place(depth(), size); });
  }
};

// Reads cells of a level of the layer's own: all channels of each, and whether it has a value, if
// `valid` is not null.
CPLErr read_own(const Layer &layer, uint32_t level, const Window &window, GByte *samples, GByte *valid) {
  const spinney_box box = {{static_cast<uint64_t>(window.x), static_cast<uint64_t>(window.y), 0},
                           {static_cast<uint64_t>(window.width), static_cast<uint64_t>(window.height), 1}};
  const size_t cells = window.cells();
  // (The fill is 0 without nodata. If no sample equals the nodata number, it is the nearest
  // sample.)
  const bool is_near = layer.info.has_nodata && !layer.has_nodata_sample;
  const size_t size = cells * layer.info.cell_size;
  const size_t flags = valid != nullptr ? cells : 0;
  spinney_dataset *const handle = layer.handle.get();
  const spinney_status status =
      is_near ? spinney_read(handle, level, &box, layer.info.nodata, samples, size, valid, flags)
              : spinney_read_filled(handle, level, &box, layer.nodata_sample, samples, size, valid, flags);
  if (status != SPINNEY_OK) {
    report();
    return CE_Failure;
  }
  return CE_None;
}

// Repeats each cell of a window for all cells inside it, which are 2^shift times as narrow.
void enlarge(const GByte *from, const Window &large, uint32_t shift, size_t size, const Window &window, GByte *to) {
  const size_t line = static_cast<size_t>(window.width) * size;
  for (int row = 0; row < window.height; ++row, to += line) {
    const int y = window.y + row;
    if (row > 0 && y >> shift == (y - 1) >> shift) {
      std::memcpy(to, to - line, line);
      continue;
    }
    const GByte *const cells = from + static_cast<size_t>((y >> shift) - large.y) * static_cast<size_t>(large.width) * size;
    for (int column = 0; column < window.width; ++column) {
      const auto cell = static_cast<size_t>(((window.x + column) >> shift) - large.x);
      std::memcpy(to + static_cast<size_t>(column) * size, cells + cell * size, size);
    }
  }
}

// Reads a window of a level of the raster: all channels of each cell of a layer, and whether it has
// a value, if `valid` is not null. The buffers are large enough.
CPLErr read(const Layer &layer, uint32_t level, const Window &window, GByte *samples, GByte *valid) {
  if (level <= layer.info.depth) {
    return read_own(layer, level, window, samples, valid);
  }
  // (A raster is less than 2^31 cells wide.)
  const uint32_t shift = std::min(level - layer.info.depth, 31u);
  const int x = window.x >> shift, y = window.y >> shift;
  const Window large = {x, y, ((window.x + window.width - 1) >> shift) - x + 1,
                        ((window.y + window.height - 1) >> shift) - y + 1};
  const auto cells = allocate(large.cells() * layer.info.cell_size);
  const auto flags = valid != nullptr ? allocate(large.cells()) : nullptr;
  if (cells == nullptr || (valid != nullptr && flags == nullptr) ||
      read_own(layer, layer.info.depth, large, cells.get(), flags.get()) != CE_None) {
    return CE_Failure;
  }
  enlarge(cells.get(), large, shift, layer.info.cell_size, window, samples);
  if (valid != nullptr) {
    enlarge(flags.get(), large, shift, 1, window, valid);
  }
  return CE_None;
}

} // namespace
