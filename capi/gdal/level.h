// A level of all layers as GDAL's dataset, with their channels as its bands.

#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "cpl_json.h"
#include "gdal_priv.h"
#include "ogr_spatialref.h"
#include "spinney.h"
#include "stack.h"

namespace {

constexpr int BLOCK = 256;
constexpr int MAX_BINS = 1 << 24;
constexpr double ENOUGH_CELLS = 1e6;

GDALDataType type_of(spinney_sample_type type) {
  switch (type) {
  case SPINNEY_U8:
    return GDT_Byte;
  case SPINNEY_U16:
    return GDT_UInt16;
  case SPINNEY_I16:
    return GDT_Int16;
  case SPINNEY_U32:
    return GDT_UInt32;
  case SPINNEY_I32:
    return GDT_Int32;
  case SPINNEY_F32:
    return GDT_Float32;
  case SPINNEY_F64:
    return GDT_Float64;
  case SPINNEY_I8:
#if GDAL_VERSION_NUM >= GDAL_COMPUTE_VERSION(3, 7, 0)
    return GDT_Int8;
#else
    return GDT_Byte; // (with PIXELTYPE, which marked signed bytes before GDAL had a type for them)
#endif
#if GDAL_VERSION_NUM >= GDAL_COMPUTE_VERSION(3, 5, 0)
  case SPINNEY_U64:
    return GDT_UInt64;
  case SPINNEY_I64:
    return GDT_Int64;
#else
  case SPINNEY_U64:
  case SPINNEY_I64:
    return GDT_Unknown;
#endif
  }
  return GDT_Unknown;
}

// The cells of a block. Blocks at the border extend beyond it, where no cell has a value.
Window block_at(int column, int row) { return {column * BLOCK, row * BLOCK, BLOCK, BLOCK}; }

// Samples in memory: a pointer to the first, and the strides in bytes to the next column and row.
struct Samples {
  GByte *first;
  GDALDataType type;
  GSpacing pixel, line;
};

// Copies samples row by row, and converts them if the types differ.
void copy(const Samples &from, const Samples &to, int width, int height) {
  for (int row = 0; row < height; ++row) {
    GDALCopyWords(from.first + row * from.line, from.type, static_cast<int>(from.pixel), to.first + row * to.line, to.type,
                  static_cast<int>(to.pixel), width);
  }
}

// The fraction of a task that one operation is, for progress reports.
struct Share {
  GDALRasterIOExtraArg *extra;
  double from = 0.0, size = 1.0;
};

// One level of all layers. The finest is the dataset that GDAL opens, the others are its overviews.
class Level final : public GDALDataset {
public:
  Level(std::shared_ptr<const Stack> of, int level);
  Level(const Level &) = delete;
  Level &operator=(const Level &) = delete;

  static int identify(GDALOpenInfo *info);
  static GDALDataset *open(GDALOpenInfo *info);

  CPLErr GetGeoTransform(double *transform) override;
  const OGRSpatialReference *GetSpatialRef() const override { return reference.IsEmpty() ? nullptr : &reference; }

  // Reads cells of some bands (numbers from 1) into a buffer. `samples` has the samples of the
  // first band.
  CPLErr read_cells(const Window &window, int band_count, const int *bands, const Samples &samples, GSpacing band_space,
                    GDALRasterIOExtraArg *extra);

  // Whether this is the level of the cells, for which the file has statistics.
  bool is_finest() const { return level() == stack->depth(); }
  uint32_t level() const { return static_cast<uint32_t>(number); }

  const std::shared_ptr<const Stack> stack;
  const int number;
  // Coarser levels, from fine to coarse.
  std::vector<std::unique_ptr<Level>> overviews;
  // Masks by layer; null for layers that need none.
  std::vector<std::unique_ptr<GDALRasterBand>> masks;

protected:
  CPLErr IRasterIO(GDALRWFlag flag, int x, int y, int width, int height, void *data, int buffer_width, int buffer_height,
                   GDALDataType type, int band_count, int *bands, GSpacing pixel_space, GSpacing line_space,
                   GSpacing band_space, GDALRasterIOExtraArg *extra) override;

private:
  CPLErr copy_blocks(const Window &strip, int band, const Samples &samples);
  CPLErr read_directly(const Layer &layer, const Window &window, int band_count, const int *bands, const Samples &samples,
                       GSpacing band_space, const Share &share);
  const Layer &layer_of(int band) const;
  void describe();
  void list_layers(const std::string &file);
  void describe_crs(const CPLJSONObject &crs);
  void describe_band(const Layer &layer, const CPLJSONObject &document, int channel);

  OGRSpatialReference reference;
};

// The mask of a level: which cells have a value.
class Mask final : public GDALRasterBand {
public:
  Mask(Level *of, size_t layer_number) : level(of), number(layer_number) {
    // A mask band has no number, and so no pointer to its dataset.
    nRasterXSize = of->GetRasterXSize();
    nRasterYSize = of->GetRasterYSize();
    eDataType = GDT_Byte;
    nBlockXSize = BLOCK;
    nBlockYSize = BLOCK;
    eAccess = GA_ReadOnly;
  }

  int GetOverviewCount() override { return static_cast<int>(level->overviews.size()); }
  GDALRasterBand *GetOverview(int index) override {
    const bool is_there = index >= 0 && index < GetOverviewCount();
    return is_there ? level->overviews[static_cast<size_t>(index)]->masks[number].get() : nullptr;
  }

protected:
  CPLErr IReadBlock(int column, int row, void *data) override {
    const Window block = block_at(column, row);
    const Layer &layer = level->stack->layers[number];
    const auto samples = allocate(block.cells() * layer.info.cell_size);
    auto *const flags = static_cast<GByte *>(data);
    if (samples == nullptr || read(layer, level->level(), block, samples.get(), flags) != CE_None) {
      return CE_Failure;
    }
    std::transform(flags, flags + block.cells(), flags,
                   [](GByte flag) { return static_cast<GByte>(flag != 0 ? 255 : 0); });
    return CE_None;
  }

private:
  Level *level;
  const size_t number;
};

// One channel of a layer, at a level.
class Channel final : public GDALRasterBand {
public:
  Channel(Level *of, size_t layer_number, int channel)
      : layer(of->stack->layers[layer_number]), level(of), number(layer_number), index(channel) {
    poDS = of;
    nBand = layer.first_band + channel;
    eDataType = type_of(layer.info.sample);
    nBlockXSize = BLOCK;
    nBlockYSize = BLOCK;
#if GDAL_VERSION_NUM < GDAL_COMPUTE_VERSION(3, 7, 0)
    if (layer.info.sample == SPINNEY_I8) {
      GDALRasterBand::SetMetadataItem("PIXELTYPE", "SIGNEDBYTE", "IMAGE_STRUCTURE");
    }
#endif
  }

#if GDAL_VERSION_NUM >= GDAL_COMPUTE_VERSION(3, 5, 0)
  int64_t GetNoDataValueAsInt64(int *success) override { return nodata_of<int64_t>(success, SPINNEY_I64); }
  uint64_t GetNoDataValueAsUInt64(int *success) override { return nodata_of<uint64_t>(success, SPINNEY_U64); }
#endif

  double GetNoDataValue(int *success) override {
    if (success != nullptr) {
      *success = layer.info.has_nodata ? TRUE : FALSE;
    }
    return layer.info.has_nodata ? layer.info.nodata : 0.0;
  }

  int GetOverviewCount() override { return static_cast<int>(level->overviews.size()); }
  GDALRasterBand *GetOverview(int at) override {
    const bool is_there = at >= 0 && at < GetOverviewCount();
    return is_there ? level->overviews[static_cast<size_t>(at)]->GetRasterBand(nBand) : nullptr;
  }

  GDALRasterBand *GetMaskBand() override {
    GDALRasterBand *const mask = level->masks[number].get();
    return mask != nullptr ? mask : GDALRasterBand::GetMaskBand();
  }
  int GetMaskFlags() override {
    if (level->masks[number] == nullptr) {
      return GDALRasterBand::GetMaskFlags();
    }
    return level->stack->layers.size() == 1 ? GMF_PER_DATASET : 0;
  }

  GDALColorTable *GetColorTable() override { return colours.get(); }
  GDALColorInterp GetColorInterpretation() override {
    const int channels = layer.channels();
    if (colours != nullptr) {
      return GCI_PaletteIndex;
    }
    if (index == layer.info.alpha) {
      return GCI_AlphaBand;
    }
    const int colour_channels = channels - (layer.info.alpha >= 0 ? 1 : 0);
    if (colour_channels == 3 && index < 3) {
      return static_cast<GDALColorInterp>(GCI_RedBand + index);
    }
    return channels == 1 || colour_channels == 1 ? GCI_GrayIndex : GCI_Undefined;
  }

  char **GetCategoryNames() override { return categories.List(); }
  const char *GetUnitType() override { return unit.c_str(); }
  double GetScale(int *success) override {
    if (success != nullptr) {
      *success = TRUE;
    }
    return scale;
  }
  double GetOffset(int *success) override {
    if (success != nullptr) {
      *success = TRUE;
    }
    return offset;
  }

  // Exact, from the tree: nothing is computed. (Overviews return the statistics of the cells, too.)
  CPLErr GetStatistics(int, int, double *min, double *max, double *mean, double *deviation) override {
    const spinney_channel_statistics &known = layer.statistics.channels[index];
    if (known.cells == 0) {
      return CE_Warning;
    }
    const double values[] = {known.min, known.max, known.mean, known.standard_deviation};
    double *const outputs[] = {min, max, mean, deviation};
    for (int i = 0; i < 4; ++i) {
      if (outputs[i] != nullptr) {
        *outputs[i] = values[i];
      }
    }
    return CE_None;
  }
  CPLErr ComputeStatistics(int is_approximate, double *min, double *max, double *mean, double *deviation,
                           GDALProgressFunc, void *) override {
    return GetStatistics(is_approximate, TRUE, min, max, mean, deviation);
  }
  CPLErr ComputeRasterMinMax(int is_approximate, double *min_max) override {
    if (!level->is_finest()) {
      return GDALRasterBand::ComputeRasterMinMax(is_approximate, min_max);
    }
    if (GetStatistics(TRUE, TRUE, &min_max[0], &min_max[1], nullptr, nullptr) != CE_None) {
      CPLError(CE_Failure, CPLE_AppDefined, "no cell has a value");
      return CE_Failure;
    }
    return CE_None;
  }

  // Exact for the first channel of the cells, which the tree counts. Other channels are read, from
  // a coarser level if that is good enough.
  CPLErr GetHistogram(double low, double high, int count, GUIntBig *bins, int with_outside, int is_approximate,
                      GDALProgressFunc progress, void *user) override {
    const double step = (high - low) / count;
    if (!level->is_finest() || index != 0 || !(step > 0.0) || !std::isfinite(step) || count > MAX_BINS) {
      return histogram_of_cells(low, high, count, bins, with_outside, is_approximate, progress, user);
    }
    // The tree counts values outside of the range in the outermost bins: two additional bins
    // separate them.
    std::vector<uint64_t> found(static_cast<size_t>(count) + 2);
    if (!layer.histogram(low - step, high + step, found)) {
      report();
      return CE_Failure;
    }
    std::copy(found.begin() + 1, found.end() - 1, bins);
    if (with_outside) {
      bins[0] += found.front();
      bins[count - 1] += found.back();
    }
    if (progress != nullptr && !progress(1.0, "", user)) {
      CPLError(CE_Failure, CPLE_UserInterrupt, "interrupted");
      return CE_Failure;
    }
    return CE_None;
  }

  double GetMinimum(int *success) override { return extreme(success, layer.statistics.channels[index].min); }
  double GetMaximum(int *success) override { return extreme(success, layer.statistics.channels[index].max); }

  std::unique_ptr<GDALColorTable> colours;
  CPLStringList categories;
  std::string unit;
  double scale = 1.0;
  double offset = 0.0;

protected:
  // The nodata number of 64-bit integers, which a double may not represent.
  template <typename T> T nodata_of(int *success, spinney_sample_type type) const {
    const bool is_there = layer.info.sample == type && layer.has_nodata_sample;
    if (success != nullptr) {
      *success = is_there ? TRUE : FALSE;
    }
    return is_there ? layer.nodata_as<T>() : 0;
  }

  CPLErr IReadBlock(int column, int row, void *data) override {
    const Window block = block_at(column, row);
    if (layer.channels() == 1) {
      return read(layer, level->level(), block, static_cast<GByte *>(data), nullptr);
    }
    const auto cells = allocate(block.cells() * layer.info.cell_size);
    if (cells == nullptr || read(layer, level->level(), block, cells.get(), nullptr) != CE_None) {
      return CE_Failure;
    }
    const GSpacing size = GDALGetDataTypeSizeBytes(eDataType);
    const GSpacing cell = layer.info.cell_size;
    for (int channel = 0; channel < layer.channels(); ++channel) {
      const Samples from = {cells.get() + channel * size, eDataType, cell, cell * BLOCK};
      const auto take = [&](void *place) {
        copy(from, {static_cast<GByte *>(place), eDataType, size, size * BLOCK}, BLOCK, BLOCK);
      };
      if (channel == index) {
        take(data);
        continue;
      }
      // GDAL's cache keeps the samples of the other channels until they are requested.
      GDALRasterBand *const other = level->GetRasterBand(layer.first_band + channel);
      GDALRasterBlock *there = other->TryGetLockedBlockRef(column, row);
      if (there == nullptr && (there = other->GetLockedBlockRef(column, row, TRUE)) != nullptr) {
        take(there->GetDataRef());
      }
      if (there != nullptr) {
        there->DropLock();
      }
    }
    return CE_None;
  }

  CPLErr IRasterIO(GDALRWFlag flag, int x, int y, int width, int height, void *data, int buffer_width, int buffer_height,
                   GDALDataType type, GSpacing pixel_space, GSpacing line_space, GDALRasterIOExtraArg *extra) override {
    if (flag == GF_Read && width == buffer_width && height == buffer_height) {
      const Samples samples = {static_cast<GByte *>(data), type, pixel_space, line_space};
      return level->read_cells({x, y, width, height}, 1, &nBand, samples, 0, extra);
    }
    return GDALRasterBand::IRasterIO(flag, x, y, width, height, data, buffer_width, buffer_height, type, pixel_space,
                                     line_space, extra);
  }

private:
  // GDAL's own histogram, over all cells, or, if approximate, over those of the coarsest level that
  // has a million of them.
  CPLErr histogram_of_cells(double low, double high, int count, GUIntBig *bins, int with_outside, int is_approximate,
                            GDALProgressFunc progress, void *user) {
    GDALRasterBand *band = this;
    for (int i = GetOverviewCount() - 1; is_approximate && band == this && i >= 0; --i) {
      GDALRasterBand *const coarser = GetOverview(i);
      if (static_cast<double>(coarser->GetXSize()) * coarser->GetYSize() >= ENOUGH_CELLS) {
        band = coarser;
      }
    }
    if (band != this) {
      return band->GetHistogram(low, high, count, bins, with_outside, FALSE, progress, user);
    }
    return GDALRasterBand::GetHistogram(low, high, count, bins, with_outside, FALSE, progress, user);
  }

  double extreme(int *success, double value) const {
    const bool is_known = layer.statistics.channels[index].cells > 0;
    if (success != nullptr) {
      *success = is_known ? TRUE : FALSE;
    }
    return is_known ? value : 0.0;
  }

  const Layer &layer;
  Level *level;
  const size_t number;
  const int index;
};

} // namespace
