// GDAL's read-only driver for Spinney files: pictures (quadtrees) of both formats, commits as `map.autumn@12`.
//
// Overviews are the tree's own levels. VOID is the nodata value where the file has one, else it is told by a mask.

#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "cpl_json.h"
#include "gdal_frmts.h"
#include "gdal_priv.h"
#include "ogr_spatialref.h"
#include "spinney.h"

namespace {

constexpr int BLOCK = 256;
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

  bool has_mask() const { return !info.has_nodata && info.alpha < 0 && statistics.void_cells > 0; }
};

// Reads a window of a level: all channels of each cell, and whether it has a value.
CPLErr read(const File &file, int level, int x, int y, int width, int height, std::vector<GByte> &samples,
            std::vector<GByte> *valid) {
  const spinney_box window = {{static_cast<uint64_t>(x), static_cast<uint64_t>(y), 0},
                              {static_cast<uint64_t>(width), static_cast<uint64_t>(height), 1}};
  const size_t cells = static_cast<size_t>(width) * static_cast<size_t>(height);
  try {
    samples.resize(cells * file.info.cell_size);
    if (valid != nullptr) {
      valid->resize(cells);
    }
  } catch (const std::bad_alloc &) {
    CPLError(CE_Failure, CPLE_OutOfMemory, "no memory for %d x %d cells", width, height);
    return CE_Failure;
  }
  const double fill = file.info.has_nodata ? file.info.nodata : 0.0;
  const spinney_status status =
      spinney_read(file.handle.get(), static_cast<uint32_t>(level), &window, fill, samples.data(), samples.size(),
                   valid != nullptr ? valid->data() : nullptr, valid != nullptr ? valid->size() : 0);
  if (status != SPINNEY_OK) {
    report();
    return CE_Failure;
  }
  return CE_None;
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
  void describe();
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
    std::vector<GByte> samples;
    std::vector<GByte> valid;
    const CPLErr error =
        read(*level->file, level->number, column * BLOCK, row * BLOCK, BLOCK, BLOCK, samples, &valid);
    if (error == CE_None) {
      std::transform(valid.begin(), valid.end(), static_cast<GByte *>(data),
                     [](GByte flag) { return static_cast<GByte>(flag != 0 ? 255 : 0); });
    }
    return error;
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
  }

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
  double GetMinimum(int *success) override { return extreme(success, level->file->statistics.channels[index].min); }
  double GetMaximum(int *success) override { return extreme(success, level->file->statistics.channels[index].max); }

  std::unique_ptr<GDALColorTable> colours;
  CPLStringList categories;
  std::string unit;
  double scale = 1.0;
  double offset = 0.0;

protected:
  CPLErr IReadBlock(int column, int row, void *data) override {
    std::vector<GByte> samples;
    // (A block at the border reaches beyond it: what is there has no value.)
    const CPLErr error =
        read(*level->file, level->number, column * BLOCK, row * BLOCK, BLOCK, BLOCK, samples, nullptr);
    if (error == CE_None) {
      const int size = GDALGetDataTypeSizeBytes(eDataType);
      GDALCopyWords(samples.data() + index * size, eDataType, static_cast<int>(level->file->info.cell_size), data,
                    eDataType, size, BLOCK * BLOCK);
    }
    return error;
  }

  // A window at its own size comes straight from the tree, without GDAL's cache of blocks in between.
  CPLErr IRasterIO(GDALRWFlag flag, int x, int y, int width, int height, void *data, int buffer_width, int buffer_height,
                   GDALDataType type, GSpacing pixel_space, GSpacing line_space, GDALRasterIOExtraArg *extra) override {
    if (flag == GF_Read && width == buffer_width && height == buffer_height) {
      int band = nBand;
      return level->RasterIO(flag, x, y, width, height, data, buffer_width, buffer_height, type, 1, &band, pixel_space,
                             line_space, 0, extra);
    }
    return GDALRasterBand::IRasterIO(flag, x, y, width, height, data, buffer_width, buffer_height, type, pixel_space,
                                     line_space, extra);
  }

private:
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
  const GDALDataType own = type_of(file->info.sample);
  const int size = GDALGetDataTypeSizeBytes(own);
  const int cell = static_cast<int>(file->info.cell_size);
  std::vector<GByte> samples;
  // Some rows at a time, so that memory does not grow with the window.
  const int rows = std::clamp((1 << 24) / std::max(1, width * cell), 1, std::max(1, height));
  for (int top = 0; top < height; top += rows) {
    const int count = std::min(rows, height - top);
    if (read(*file, number, x, y + top, width, count, samples, nullptr) != CE_None) {
      return CE_Failure;
    }
    for (int i = 0; i < band_count; ++i) {
      for (int row = 0; row < count; ++row) {
        const GByte *from = samples.data() + static_cast<size_t>(row) * width * cell + (bands[i] - 1) * size;
        GByte *to = static_cast<GByte *>(data) + i * band_space + (top + row) * line_space;
        GDALCopyWords(from, own, cell, to, type, static_cast<int>(pixel_space), width);
      }
    }
    if (extra != nullptr && extra->pfnProgress != nullptr &&
        !extra->pfnProgress(static_cast<double>(top + count) / height, "", extra->pProgressData)) {
      CPLError(CE_Failure, CPLE_UserInterrupt, "interrupted");
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
  std::string definition = root.GetString("crs/definition");
  if (root.GetString("crs/form") == "GeoTIFF keys") {
    definition = root.GetString("crs/epsg");
  }
  reference.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  if (!definition.empty() && reference.SetFromUserInput(definition.c_str()) != OGRERR_NONE) {
    CPLError(CE_Warning, CPLE_AppDefined, "the coordinate system is not one that PROJ knows: %s", definition.c_str());
    reference.Clear();
  }
  CPLStringList tags;
  for (const CPLJSONObject &tag : root.GetObj("tags").GetChildren()) {
    tags.SetNameValue(tag.GetName().c_str(), tag.ToString().c_str());
  }
  if (file->info.commit > 0) {
    tags.SetNameValue("SPINNEY_COMMIT", std::to_string(file->info.commit).c_str());
  }
  SetMetadata(tags.List());
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
    band->SetMetadataItem("STATISTICS_MINIMUM", CPLSPrintf("%.17g", known.min));
    band->SetMetadataItem("STATISTICS_MAXIMUM", CPLSPrintf("%.17g", known.max));
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
  for (int level = depth - 1; level >= 0; --level) {
    auto overview = std::make_unique<Level>(file, level);
    const bool is_last = overview->GetRasterXSize() <= 1 && overview->GetRasterYSize() <= 1;
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
