// GDAL's read-only driver for Spinney files: pictures (quadtrees) of both formats, commits as `map.autumn@12`.
//
// Overviews are the tree's own levels. VOID is the nodata value where the file has one, else it is told by a mask. Blocks wait in GDAL's
// cache, each channel for itself; windows are copied from there, or come straight from the tree where they are too large for it.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "cpl_json.h"
#include "gdal_frmts.h"
#include "gdal_priv.h"
#include "ogr_spatialref.h"
#include "spinney.h"

namespace {

constexpr int BLOCK = 256;
// Sides of the coarsest overview: programs expect a block of it, and make smaller pictures of that.
constexpr int COARSEST = 256;
constexpr int MOST_BINS = 1 << 24;
constexpr double ENOUGH_CELLS = 1e6;
const char *const DRIVER = "Spinney";

void report() { CPLError(CE_Failure, CPLE_AppDefined, "%s", spinney_error()); }

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
    return GDT_Byte; // (with PIXELTYPE, as GDAL told such bytes before it had a type for them)
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

struct Close {
  void operator()(spinney_dataset *file) const { spinney_close(file); }
};

// A file, and what all of its levels have in common.
struct File {
  std::unique_ptr<spinney_dataset, Close> handle;
  spinney_info info{};
  spinney_statistics statistics{};

  // The nodata number as a sample, if a sample can be that.
  bool has_nodata_sample = false;
  GByte nodata_sample[8] = {};

  template <typename T> T nodata_as() const {
    T number = 0;
    std::memcpy(&number, nodata_sample, sizeof number);
    return number;
  }

  // Extremes of the first channel, where it has integers of 64 bits.
  GByte least[8] = {}, greatest[8] = {};

  // An extreme as text, exactly.
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

  bool has_mask() const { return !info.has_nodata && info.alpha < 0 && statistics.void_cells > 0; }
};

// Cells of a level.
struct Window {
  int x, y, width, height;

  size_t cells() const { return static_cast<size_t>(width) * static_cast<size_t>(height); }
};

// Reads a window of a level: all channels of each cell, and whether it has a value, if `valid` is not null. There is room for all.
CPLErr read(const File &file, int level, const Window &window, GByte *samples, GByte *valid) {
  const spinney_box box = {{static_cast<uint64_t>(window.x), static_cast<uint64_t>(window.y), 0},
                           {static_cast<uint64_t>(window.width), static_cast<uint64_t>(window.height), 1}};
  const size_t cells = window.cells();
  // (Zeros where there is none; of a number that no sample is the nearest.)
  const bool is_near = file.info.has_nodata && !file.has_nodata_sample;
  const size_t size = cells * file.info.cell_size;
  const size_t flags = valid != nullptr ? cells : 0;
  const spinney_status status =
      is_near ? spinney_read(file.handle.get(), static_cast<uint32_t>(level), &box, file.info.nodata, samples, size, valid, flags)
              : spinney_read_filled(file.handle.get(), static_cast<uint32_t>(level), &box, file.nodata_sample, samples, size,
                                    valid, flags);
  if (status != SPINNEY_OK) {
    report();
    return CE_Failure;
  }
  return CE_None;
}

// Room for bytes; null, with GDAL's error, if there is none.
std::unique_ptr<GByte[]> room(size_t bytes) {
  std::unique_ptr<GByte[]> bytes_there(new (std::nothrow) GByte[bytes]);
  if (bytes_there == nullptr) {
    CPLError(CE_Failure, CPLE_OutOfMemory, "no memory for %llu bytes", static_cast<unsigned long long>(bytes));
  }
  return bytes_there;
}

// The cells of a block: one at the border reaches beyond it, where nothing has a value.
Window block_at(int column, int row) { return {column * BLOCK, row * BLOCK, BLOCK, BLOCK}; }

// Samples in memory: the first of them, and bytes from one to the next and to that below it.
struct Samples {
  GByte *first;
  GDALDataType type;
  GSpacing pixel, line;
};

// Copies samples row by row, to another type if wanted.
void copy(const Samples &from, const Samples &to, int width, int height) {
  for (int row = 0; row < height; ++row) {
    GDALCopyWords(from.first + row * from.line, from.type, static_cast<int>(from.pixel), to.first + row * to.line, to.type,
                  static_cast<int>(to.pixel), width);
  }
}

// One level of a file. The finest is the dataset that GDAL opens, the others are its overviews.
class Level final : public GDALDataset {
public:
  Level(std::shared_ptr<const File> of, int level);
  Level(const Level &) = delete;
  Level &operator=(const Level &) = delete;

  static int identify(GDALOpenInfo *info);
  static GDALDataset *open(GDALOpenInfo *info);

  CPLErr GetGeoTransform(double *transform) override;
  const OGRSpatialReference *GetSpatialRef() const override { return reference.IsEmpty() ? nullptr : &reference; }

  // Reads cells of some bands (numbers from 1) into a buffer whose `samples` are those of the first of them.
  CPLErr read_cells(const Window &window, int band_count, const int *bands, const Samples &samples, GSpacing band_space,
                    GDALRasterIOExtraArg *extra);

  // Whether this is the level of the cells, of which the file knows statistics.
  bool is_finest() const { return static_cast<uint32_t>(number) == file->info.depth; }

  const std::shared_ptr<const File> file;
  const int number;
  // Coarser levels, the finest of them first.
  std::vector<std::unique_ptr<Level>> overviews;
  std::unique_ptr<GDALRasterBand> mask;

protected:
  CPLErr IRasterIO(GDALRWFlag flag, int x, int y, int width, int height, void *data, int buffer_width, int buffer_height,
                   GDALDataType type, int band_count, int *bands, GSpacing pixel_space, GSpacing line_space,
                   GSpacing band_space, GDALRasterIOExtraArg *extra) override;

private:
  CPLErr copy_blocks(const Window &strip, int band, const Samples &samples);
  CPLErr read_directly(const Window &window, int band_count, const int *bands, const Samples &samples, GSpacing band_space,
                       GDALRasterIOExtraArg *extra);
  void describe();
  void describe_crs(const CPLJSONObject &crs);
  void describe_band(const CPLJSONObject &document, int channel);

  OGRSpatialReference reference;
};

// The cells of a level that have a value.
class Mask final : public GDALRasterBand {
public:
  explicit Mask(Level *of) {
    // A mask band's dataset is not told, since it has no number there.
    level = of;
    nRasterXSize = of->GetRasterXSize();
    nRasterYSize = of->GetRasterYSize();
    eDataType = GDT_Byte;
    nBlockXSize = BLOCK;
    nBlockYSize = BLOCK;
    eAccess = GA_ReadOnly;
  }

  int GetOverviewCount() override { return static_cast<int>(level->overviews.size()); }
  GDALRasterBand *GetOverview(int index) override {
    return index >= 0 && index < GetOverviewCount() ? level->overviews[static_cast<size_t>(index)]->mask.get() : nullptr;
  }

protected:
  CPLErr IReadBlock(int column, int row, void *data) override {
    const Window block = block_at(column, row);
    const auto samples = room(block.cells() * level->file->info.cell_size);
    auto *const flags = static_cast<GByte *>(data);
    if (samples == nullptr || read(*level->file, level->number, block, samples.get(), flags) != CE_None) {
      return CE_Failure;
    }
    std::transform(flags, flags + block.cells(), flags,
                   [](GByte flag) { return static_cast<GByte>(flag != 0 ? 255 : 0); });
    return CE_None;
  }

private:
  Level *level;
};

// One channel of a level.
class Channel final : public GDALRasterBand {
public:
  Channel(Level *of, int channel) : level(of), index(channel) {
    poDS = of;
    nBand = channel + 1;
    eDataType = type_of(of->file->info.sample);
    nBlockXSize = BLOCK;
    nBlockYSize = BLOCK;
#if GDAL_VERSION_NUM < GDAL_COMPUTE_VERSION(3, 7, 0)
    if (of->file->info.sample == SPINNEY_I8) {
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
      *success = level->file->info.has_nodata ? TRUE : FALSE;
    }
    return level->file->info.has_nodata ? level->file->info.nodata : 0.0;
  }

  int GetOverviewCount() override { return static_cast<int>(level->overviews.size()); }
  GDALRasterBand *GetOverview(int number) override {
    const bool is_there = number >= 0 && number < GetOverviewCount();
    return is_there ? level->overviews[static_cast<size_t>(number)]->GetRasterBand(nBand) : nullptr;
  }

  GDALRasterBand *GetMaskBand() override {
    return level->mask != nullptr ? level->mask.get() : GDALRasterBand::GetMaskBand();
  }
  int GetMaskFlags() override { return level->mask != nullptr ? GMF_PER_DATASET : GDALRasterBand::GetMaskFlags(); }

  GDALColorTable *GetColorTable() override { return colours.get(); }
  GDALColorInterp GetColorInterpretation() override {
    const int channels = static_cast<int>(level->file->info.channels);
    if (colours != nullptr) {
      return GCI_PaletteIndex;
    }
    if (index == level->file->info.alpha) {
      return GCI_AlphaBand;
    }
    const int colour_channels = channels - (level->file->info.alpha >= 0 ? 1 : 0);
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

  // Exact, from what the tree stores: nothing is computed. (Those of the cells, also for overviews.)
  CPLErr GetStatistics(int, int, double *min, double *max, double *mean, double *deviation) override {
    const spinney_channel_statistics &known = level->file->statistics.channels[index];
    if (known.cells == 0) {
      return CE_Warning;
    }
    const double values[] = {known.min, known.max, known.mean, known.standard_deviation};
    double *const places[] = {min, max, mean, deviation};
    for (int i = 0; i < 4; ++i) {
      if (places[i] != nullptr) {
        *places[i] = values[i];
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

  // Exact where the tree counts: the first channel of the cells. Other channels are read, from a coarser level if that is good enough.
  CPLErr GetHistogram(double low, double high, int count, GUIntBig *bins, int with_outside, int is_approximate,
                      GDALProgressFunc progress, void *user) override {
    const double step = (high - low) / count;
    if (!level->is_finest() || index != 0 || !(step > 0.0) || !std::isfinite(step) || count > MOST_BINS) {
      return histogram_of_cells(low, high, count, bins, with_outside, is_approximate, progress, user);
    }
    // The tree counts what is outside for the outermost parts: two more of them keep it away from the others.
    std::vector<uint64_t> found(static_cast<size_t>(count) + 2);
    if (spinney_histogram(level->file->handle.get(), nullptr, low - step, high + step, found.data(), found.size()) !=
        SPINNEY_OK) {
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

  double GetMinimum(int *success) override { return extreme(success, level->file->statistics.channels[index].min); }
  double GetMaximum(int *success) override { return extreme(success, level->file->statistics.channels[index].max); }

  std::unique_ptr<GDALColorTable> colours;
  CPLStringList categories;
  std::string unit;
  double scale = 1.0;
  double offset = 0.0;

protected:
  // The nodata number of integers of 64 bits, which a double may not have.
  template <typename T> T nodata_of(int *success, spinney_sample_type type) const {
    const File &file = *level->file;
    const bool is_there = file.info.sample == type && file.has_nodata_sample;
    if (success != nullptr) {
      *success = is_there ? TRUE : FALSE;
    }
    return is_there ? file.nodata_as<T>() : 0;
  }

  CPLErr IReadBlock(int column, int row, void *data) override {
    const File &file = *level->file;
    const Window block = block_at(column, row);
    if (file.info.channels == 1) {
      return read(file, level->number, block, static_cast<GByte *>(data), nullptr);
    }
    const auto cells = room(block.cells() * file.info.cell_size);
    if (cells == nullptr || read(file, level->number, block, cells.get(), nullptr) != CE_None) {
      return CE_Failure;
    }
    const GSpacing size = GDALGetDataTypeSizeBytes(eDataType);
    const GSpacing cell = file.info.cell_size;
    for (int channel = 0; channel < static_cast<int>(file.info.channels); ++channel) {
      const Samples from = {cells.get() + channel * size, eDataType, cell, cell * BLOCK};
      const auto take = [&](void *place) {
        copy(from, {static_cast<GByte *>(place), eDataType, size, size * BLOCK}, BLOCK, BLOCK);
      };
      if (channel == index) {
        take(data);
        continue;
      }
      // What was read of the other channels waits for them in GDAL's cache.
      GDALRasterBand *const other = level->GetRasterBand(channel + 1);
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
  // GDAL's own way, over all cells; approximately over those of the coarsest level that has a million of them.
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
    const bool is_known = level->file->statistics.channels[index].cells > 0;
    if (success != nullptr) {
      *success = is_known ? TRUE : FALSE;
    }
    return is_known ? value : 0.0;
  }

  Level *level;
  const int index;
};

Level::Level(std::shared_ptr<const File> of, int level) : file(std::move(of)), number(level) {
  uint64_t size[3] = {1, 1, 1};
  spinney_level_size(file->handle.get(), static_cast<uint32_t>(level), &size);
  nRasterXSize = static_cast<int>(size[0]);
  nRasterYSize = static_cast<int>(size[1]);
  eAccess = GA_ReadOnly;
  for (uint32_t channel = 0; channel < file->info.channels; ++channel) {
    SetBand(static_cast<int>(channel) + 1, new Channel(this, static_cast<int>(channel)));
  }
  if (file->has_mask()) {
    mask = std::make_unique<Mask>(this);
  }
  describe();
}

CPLErr Level::GetGeoTransform(double *transform) {
  const double *m = file->info.matrix;
  const double numbers[] = {m[3], m[0], m[1], m[7], m[4], m[5]};
  std::copy(std::begin(numbers), std::end(numbers), transform);
  // Cells of a coarser level are larger by a power of two.
  const double scale = static_cast<double>(1ull << (file->info.depth - static_cast<uint32_t>(number)));
  for (const int i : {1, 2, 4, 5}) {
    transform[i] *= scale;
  }
  return file->info.has_georeference ? CE_None : CE_Failure;
}

CPLErr Level::IRasterIO(GDALRWFlag flag, int x, int y, int width, int height, void *data, int buffer_width,
                        int buffer_height, GDALDataType type, int band_count, int *bands, GSpacing pixel_space,
                        GSpacing line_space, GSpacing band_space, GDALRasterIOExtraArg *extra) {
  if (flag != GF_Read || width != buffer_width || height != buffer_height) {
    return GDALDataset::IRasterIO(flag, x, y, width, height, data, buffer_width, buffer_height, type, band_count, bands,
                                  pixel_space, line_space, band_space, extra);
  }
  const Samples samples = {static_cast<GByte *>(data), type, pixel_space, line_space};
  return read_cells({x, y, width, height}, band_count, bands, samples, band_space, extra);
}

// Tells how much is done; an error if GDAL's user wants no more.
CPLErr tell(GDALRasterIOExtraArg *extra, double done) {
  if (extra == nullptr || extra->pfnProgress == nullptr || extra->pfnProgress(done, "", extra->pProgressData)) {
    return CE_None;
  }
  CPLError(CE_Failure, CPLE_UserInterrupt, "interrupted");
  return CE_Failure;
}

CPLErr Level::read_cells(const Window &window, int band_count, const int *bands, const Samples &samples,
                         GSpacing band_space, GDALRasterIOExtraArg *extra) {
  // What would push all else out of the cache goes past it.
  const double bytes = static_cast<double>(window.cells()) * file->info.cell_size;
  if (bytes > static_cast<double>(GDALGetCacheMax64()) / 4) {
    return read_directly(window, band_count, bands, samples, band_space, extra);
  }
  const int bottom = window.y + window.height;
  for (int row = window.y / BLOCK; row * BLOCK < bottom; ++row) {
    const int top = std::max(window.y, row * BLOCK);
    const Window strip = {window.x, top, window.width, std::min(bottom, (row + 1) * BLOCK) - top};
    for (int i = 0; i < band_count; ++i) {
      GByte *const to = samples.first + i * band_space + (top - window.y) * samples.line;
      if (copy_blocks(strip, bands[i], {to, samples.type, samples.pixel, samples.line}) != CE_None) {
        return CE_Failure;
      }
    }
    if (tell(extra, static_cast<double>(top + strip.height - window.y) / window.height) != CE_None) {
      return CE_Failure;
    }
  }
  return CE_None;
}

// Copies cells of a row of blocks. Rows of samples are written from their first to their last.
CPLErr Level::copy_blocks(const Window &strip, int band, const Samples &samples) {
  const GDALDataType own = type_of(file->info.sample);
  const GSpacing size = GDALGetDataTypeSizeBytes(own);
  const bool plain = samples.type == own && samples.pixel == size;
  const GSpacing width_in_bytes = strip.width * size;
  const int row = strip.y / BLOCK, first = strip.x / BLOCK, last = (strip.x + strip.width - 1) / BLOCK;
  GDALRasterBand *const channel = GetRasterBand(band);
  // So many blocks at a time are locked in the cache.
  constexpr int MOST = 64;
  for (int begin = first; begin <= last; begin += MOST) {
    const int end = std::min(begin + MOST, last + 1);
    struct Piece {
      GDALRasterBlock *block;
      const GByte *from;
      GByte *to;
      int width;
      size_t bytes;
    };
    Piece pieces[MOST];
    int count = 0;
    for (int column = begin; column < end; ++column) {
      GDALRasterBlock *const block = channel->GetLockedBlockRef(column, row);
      if (block == nullptr) {
        break;
      }
      const int left = std::max(strip.x, column * BLOCK), right = std::min(strip.x + strip.width, (column + 1) * BLOCK);
      const GSpacing at = static_cast<GSpacing>(strip.y - row * BLOCK) * BLOCK + (left - column * BLOCK);
      const int width = right - left;
      pieces[count++] = {block, static_cast<GByte *>(block->GetDataRef()) + at * size,
                         samples.first + (left - strip.x) * samples.pixel, width, static_cast<size_t>(width * size)};
    }
    const bool is_whole = count == end - begin;
    if (is_whole && plain && count == 1 && width_in_bytes == samples.line && pieces[0].width == BLOCK) {
      std::memcpy(pieces[0].to, pieces[0].from, pieces[0].bytes * static_cast<size_t>(strip.height));
    } else if (is_whole) {
      for (int line = 0; line < strip.height; ++line) {
        for (int i = 0; i < count; ++i) {
          Piece &piece = pieces[i];
          if (plain) {
            std::memcpy(piece.to, piece.from, piece.bytes);
          } else {
            GDALCopyWords(piece.from, own, static_cast<int>(size), piece.to, samples.type,
                          static_cast<int>(samples.pixel), piece.width);
          }
          piece.from += size * BLOCK;
          piece.to += samples.line;
        }
      }
    }
    for (int i = 0; i < count; ++i) {
      pieces[i].block->DropLock();
    }
    if (!is_whole) {
      return CE_Failure;
    }
  }
  return CE_None;
}

// Reads from the tree itself.
CPLErr Level::read_directly(const Window &window, int band_count, const int *bands, const Samples &samples,
                            GSpacing band_space, GDALRasterIOExtraArg *extra) {
  const GDALDataType own = type_of(file->info.sample);
  const GSpacing size = GDALGetDataTypeSizeBytes(own);
  const GSpacing cell = file->info.cell_size;
  const GSpacing line = cell * window.width;
  const bool as_it_is = file->info.channels == 1 && samples.type == own && samples.pixel == size && samples.line == line;
  // Some rows at a time, so that memory does not grow with the window.
  const int rows = std::clamp(static_cast<int>((1 << 24) / std::max<GSpacing>(1, line)), 1, std::max(1, window.height));
  const auto cells = as_it_is ? nullptr : room(static_cast<size_t>(line) * static_cast<size_t>(rows));
  if (!as_it_is && cells == nullptr) {
    return CE_Failure;
  }
  for (int top = 0; top < window.height; top += rows) {
    const Window part = {window.x, window.y + top, window.width, std::min(rows, window.height - top)};
    GByte *const to = samples.first + top * samples.line;
    if (read(*file, number, part, as_it_is ? to : cells.get(), nullptr) != CE_None) {
      return CE_Failure;
    }
    for (int i = 0; i < band_count && !as_it_is; ++i) {
      copy({cells.get() + (bands[i] - 1) * size, own, cell, line},
           {to + i * band_space, samples.type, samples.pixel, samples.line}, part.width, part.height);
    }
    if (tell(extra, static_cast<double>(top + part.height) / window.height) != CE_None) {
      return CE_Failure;
    }
  }
  return CE_None;
}

void Level::describe() {
  CPLJSONDocument document;
  if (!document.LoadMemory(std::string(spinney_metadata(file->handle.get())))) {
    return;
  }
  const CPLJSONObject root = document.GetRoot();
  CPLStringList tags;
  for (const CPLJSONObject &tag : root.GetObj("tags").GetChildren()) {
    tags.SetNameValue(tag.GetName().c_str(), tag.ToString().c_str());
  }
  if (file->info.commit > 0) {
    tags.SetNameValue("SPINNEY_COMMIT", std::to_string(file->info.commit).c_str());
  }
  SetMetadata(tags.List());
  describe_crs(root.GetObj("crs"));
  SetMetadataItem("INTERLEAVE", "PIXEL", "IMAGE_STRUCTURE");
  for (int channel = 0; channel < nBands; ++channel) {
    describe_band(root, channel);
  }
  for (const CPLJSONObject &scoped : root.GetArray("scoped_tags")) {
    const std::string domain = scoped.GetString("domain");
    const int channel = scoped.GetInteger("channel", -1);
    for (const CPLJSONObject &tag : scoped.GetObj("tags").GetChildren()) {
      const std::string value = tag.ToString();
      if (channel < 0) {
        SetMetadataItem(tag.GetName().c_str(), value.c_str(), domain.c_str());
      } else if (channel < nBands) {
        GetRasterBand(channel + 1)->SetMetadataItem(tag.GetName().c_str(), value.c_str(), domain.c_str());
      }
    }
  }
}

void Level::describe_crs(const CPLJSONObject &crs) {
  const std::string definition = crs.IsValid() ? crs.GetString("definition") : "";
  if (definition.empty()) {
    return;
  }
  reference.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  const std::string text = crs.GetString("text");
  if (!text.empty() && reference.SetFromUserInput(text.c_str()) == OGRERR_NONE) {
    return;
  }
  // Nobody shall take it for a picture without a system.
  reference.Clear();
  SetMetadataItem("SPINNEY_CRS", definition.c_str());
  if (is_finest()) {
    const std::string problem = crs.GetString("problem");
    CPLError(CE_Warning, CPLE_AppDefined, "the coordinate system is told by the metadata item SPINNEY_CRS alone: %s",
             problem.empty() ? "PROJ does not know it" : problem.c_str());
  }
}

void Level::describe_band(const CPLJSONObject &document, int channel) {
  auto *band = static_cast<Channel *>(GetRasterBand(channel + 1));
  const CPLJSONArray bands = document.GetArray("bands");
  if (channel < bands.Size()) {
    const CPLJSONObject own = bands[channel];
    const CPLJSONObject name = own.GetObj("name");
    if (name.GetType() == CPLJSONObject::Type::String) {
      band->SetDescription(name.ToString().c_str());
    }
    const CPLJSONObject unit = own.GetObj("unit");
    if (unit.GetType() == CPLJSONObject::Type::String) {
      band->unit = unit.ToString();
    }
    band->scale = own.GetDouble("scale", 1.0);
    band->offset = own.GetDouble("offset", 0.0);
  }
  // Statistics, as GDAL keeps them.
  const spinney_channel_statistics &known = file->statistics.channels[channel];
  if (known.cells > 0) {
    band->SetMetadataItem("STATISTICS_MINIMUM", file->extreme(file->least, known.min).c_str());
    band->SetMetadataItem("STATISTICS_MAXIMUM", file->extreme(file->greatest, known.max).c_str());
    band->SetMetadataItem("STATISTICS_MEAN", CPLSPrintf("%.17g", known.mean));
    band->SetMetadataItem("STATISTICS_STDDEV", CPLSPrintf("%.17g", known.standard_deviation));
  }
  if (nBands > 1) {
    return;
  }
  const CPLJSONObject palette = document.GetObj("palette");
  const bool has_indices = band->GetRasterDataType() == GDT_Byte || band->GetRasterDataType() == GDT_UInt16;
  if (palette.GetType() == CPLJSONObject::Type::Array && has_indices) {
    band->colours = std::make_unique<GDALColorTable>();
    int value = 0;
    for (const CPLJSONObject &colour : palette.ToArray()) {
      const CPLJSONArray parts = colour.ToArray();
      GDALColorEntry entry{};
      entry.c1 = static_cast<short>(parts[0].ToInteger());
      entry.c2 = static_cast<short>(parts[1].ToInteger());
      entry.c3 = static_cast<short>(parts[2].ToInteger());
      entry.c4 = static_cast<short>(parts[3].ToInteger());
      band->colours->SetColorEntry(value++, &entry);
    }
  }
  // GDAL's names are those of 0, 1, 2 ...; a few numbers that are far from 0 would make a very long list.
  constexpr long MOST_NAMES = 65536;
  std::vector<std::string> names;
  for (const CPLJSONObject &category : document.GetObj("categories").GetChildren()) {
    const long value = std::strtol(category.GetName().c_str(), nullptr, 10);
    if (value >= 0 && value < MOST_NAMES) {
      names.resize(std::max(names.size(), static_cast<size_t>(value) + 1));
      names[static_cast<size_t>(value)] = category.ToString();
    }
  }
  for (const std::string &name : names) {
    band->categories.AddString(name.c_str());
  }
}

// Whether a name is that of a commit: `map.autumn@12`.
bool is_commit(const char *name) {
  const char *at = std::strrchr(name, '@');
  return at != nullptr && at[1] != '\0' && std::strspn(at + 1, "0123456789") == std::strlen(at + 1);
}

int Level::identify(GDALOpenInfo *info) {
  if (info->nHeaderBytes < 8) {
    return is_commit(info->pszFilename) ? TRUE : FALSE;
  }
  const auto *magic = reinterpret_cast<const char *>(info->pabyHeader);
  return std::memcmp(magic, "\x93Goblin\n", 8) == 0 || std::memcmp(magic, "\x93" "Autumn\n", 8) == 0;
}

GDALDataset *Level::open(GDALOpenInfo *info) {
  if (!identify(info)) {
    return nullptr;
  }
  if (info->eAccess == GA_Update) {
    CPLError(CE_Failure, CPLE_NotSupported, "Spinney files are read-only for GDAL; see `spinney edit`");
    return nullptr;
  }
  auto file = std::make_shared<File>();
  spinney_dataset *handle = nullptr;
  if (spinney_open(info->pszFilename, nullptr, 0, 0, &handle) != SPINNEY_OK) {
    report();
    return nullptr;
  }
  file->handle.reset(handle);
  if (spinney_describe(handle, &file->info, sizeof file->info) != SPINNEY_OK ||
      spinney_statistics_of(handle, nullptr, &file->statistics) != SPINNEY_OK) {
    report();
    return nullptr;
  }
  const size_t sample = file->info.cell_size / file->info.channels;
  file->has_nodata_sample = spinney_nodata(handle, file->nodata_sample, sample) == SPINNEY_OK;
  if (file->info.sample == SPINNEY_U64 || file->info.sample == SPINNEY_I64) {
    if (spinney_extremes(handle, nullptr, file->least, file->greatest, sizeof file->least) != SPINNEY_OK) {
      report();
      return nullptr;
    }
  }
  if (file->info.axes != 2) {
    CPLError(CE_Failure, CPLE_NotSupported, "%s: is an octree; GDAL reads pictures (see `spinney export`)",
             info->pszFilename);
    return nullptr;
  }
  const uint64_t most = static_cast<uint64_t>(std::numeric_limits<int>::max()) - BLOCK;
  if (file->info.size[0] > most || file->info.size[1] > most) {
    CPLError(CE_Failure, CPLE_NotSupported, "%s: is larger than GDAL's pictures can be", info->pszFilename);
    return nullptr;
  }
  const int depth = static_cast<int>(file->info.depth);
  auto dataset = std::make_unique<Level>(file, depth);
  dataset->SetDescription(info->pszFilename);
  const bool is_small = dataset->GetRasterXSize() <= COARSEST && dataset->GetRasterYSize() <= COARSEST;
  for (int level = depth - 1; level >= 0 && !is_small; --level) {
    auto overview = std::make_unique<Level>(file, level);
    const bool is_last = overview->GetRasterXSize() <= COARSEST && overview->GetRasterYSize() <= COARSEST;
    dataset->overviews.push_back(std::move(overview));
    if (is_last) {
      break;
    }
  }
  return dataset.release();
}

} // namespace

extern "C" CPL_DLL void GDALRegister_Spinney() {
  if (!GDAL_CHECK_VERSION("Spinney") || GDALGetDriverByName(DRIVER) != nullptr) {
    return;
  }
  auto *driver = new GDALDriver();
  driver->SetDescription(DRIVER);
  driver->SetMetadataItem(GDAL_DCAP_RASTER, "YES");
  driver->SetMetadataItem(GDAL_DMD_LONGNAME, "Spinney quadtrees (Goblin, Autumnal)");
  driver->SetMetadataItem(GDAL_DMD_EXTENSIONS, "goblin autumn");
  driver->pfnIdentify = Level::identify;
  driver->pfnOpen = Level::open;
  GetGDALDriverManager()->RegisterDriver(driver);
}
