// GDAL's read-only driver for Spinney files: rasters (quadtrees) of both formats, commits as
// `map.autumn@12`.
//
// A dataset has the bands of all layers of a file, in order, each layer with its own type, on the
// cells of the finest layer; `stack.goblin:B08` is one layer. Overviews are the trees' own levels.
// VOID is the nodata value where a layer has one, otherwise a mask has it. GDAL's cache holds
// blocks, separately per channel. Windows are copied from it, or read directly from the tree if
// they are too large for it.

#include <algorithm>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "cpl_json.h"
#include "gdal_frmts.h"
#include "gdal_priv.h"
#include "level.h"
#include "ogr_spatialref.h"
#include "spinney.h"
#include "stack.h"

namespace {

// Size of the coarsest overview: programs expect to read one block of it, and make smaller images
// from that.
constexpr int COARSEST = 256;
// Maximum number of layers in a dataset.
constexpr size_t MAX_LAYERS = 1000;
const char *const DRIVER = "Spinney";

Level::Level(std::shared_ptr<const Stack> of, int which) : stack(std::move(of)), number(which) {
  nRasterXSize = stack->extent(0, level());
  nRasterYSize = stack->extent(1, level());
  eAccess = GA_ReadOnly;
  for (size_t i = 0; i < stack->layers.size(); ++i) {
    const Layer &layer = stack->layers[i];
    for (int channel = 0; channel < layer.channels(); ++channel) {
      SetBand(layer.first_band + channel, new Channel(this, i, channel));
    }
    masks.push_back(layer.has_mask() ? std::make_unique<Mask>(this, i) : nullptr);
  }
  describe();
}

const Layer &Level::layer_of(int band) const {
  const auto is_after = [](int number, const Layer &layer) { return number < layer.first_band; };
  return *(std::upper_bound(stack->layers.begin(), stack->layers.end(), band, is_after) - 1);
}

CPLErr Level::GetGeoTransform(double *transform) {
  const spinney_info &info = stack->reference().info;
  const double *m = info.matrix;
  const double numbers[] = {m[3], m[0], m[1], m[7], m[4], m[5]};
  std::copy(std::begin(numbers), std::end(numbers), transform);
  // Cells of a coarser level are larger by a power of two.
  const double scale = static_cast<double>(1ull << (info.depth - level()));
  for (const int i : {1, 2, 4, 5}) {
    transform[i] *= scale;
  }
  return info.has_georeference ? CE_None : CE_Failure;
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

// Reports progress. Fails if GDAL's user cancels.
CPLErr report_progress(const Share &share, double done) {
  GDALRasterIOExtraArg *const extra = share.extra;
  if (extra == nullptr || extra->pfnProgress == nullptr ||
      extra->pfnProgress(share.from + share.size * done, "", extra->pProgressData)) {
    return CE_None;
  }
  CPLError(CE_Failure, CPLE_UserInterrupt, "interrupted");
  return CE_Failure;
}

CPLErr Level::read_cells(const Window &window, int band_count, const int *bands, const Samples &samples,
                         GSpacing band_space, GDALRasterIOExtraArg *extra) {
  // Consecutive bands of one layer are read together.
  std::vector<std::pair<int, int>> runs;
  double cell_size = 0.0;
  for (int first = 0, end; first < band_count; first = end) {
    const Layer &layer = layer_of(bands[first]);
    for (end = first + 1; end < band_count && layer.has_band(bands[end]);) {
      ++end;
    }
    runs.emplace_back(first, end);
    cell_size += layer.info.cell_size;
  }
  // A window that would evict everything else bypasses the cache.
  if (static_cast<double>(window.cells()) * cell_size > static_cast<double>(GDALGetCacheMax64()) / 4) {
    const double share = 1.0 / static_cast<double>(runs.size());
    for (size_t i = 0; i < runs.size(); ++i) {
      const auto [first, end] = runs[i];
      const Samples part = {samples.first + first * band_space, samples.type, samples.pixel, samples.line};
      if (read_directly(layer_of(bands[first]), window, end - first, bands + first, part, band_space,
                        {extra, share * static_cast<double>(i), share}) != CE_None) {
        return CE_Failure;
      }
    }
    return CE_None;
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
    if (report_progress({extra}, static_cast<double>(top + strip.height - window.y) / window.height) != CE_None) {
      return CE_Failure;
    }
  }
  return CE_None;
}

// Copies cells of a row of blocks. Rows of samples are written from their first to their last.
CPLErr Level::copy_blocks(const Window &strip, int band, const Samples &samples) {
  GDALRasterBand *const channel = GetRasterBand(band);
  const GDALDataType own = channel->GetRasterDataType();
  const GSpacing size = GDALGetDataTypeSizeBytes(own);
  const bool plain = samples.type == own && samples.pixel == size;
  const GSpacing width_in_bytes = strip.width * size;
  const int row = strip.y / BLOCK, first = strip.x / BLOCK, last = (strip.x + strip.width - 1) / BLOCK;
  // Maximum number of blocks that are locked in the cache at a time.
  constexpr int MAX_LOCKED = 64;
  for (int begin = first; begin <= last; begin += MAX_LOCKED) {
    const int end = std::min(begin + MAX_LOCKED, last + 1);
    struct BlockSpan {
      GDALRasterBlock *block;
      const GByte *from;
      GByte *to;
      int width;
      size_t bytes;
    };
    BlockSpan spans[MAX_LOCKED];
    int count = 0;
    for (int column = begin; column < end; ++column) {
      GDALRasterBlock *const block = channel->GetLockedBlockRef(column, row);
      if (block == nullptr) {
        break;
      }
      const int left = std::max(strip.x, column * BLOCK), right = std::min(strip.x + strip.width, (column + 1) * BLOCK);
      const GSpacing at = static_cast<GSpacing>(strip.y - row * BLOCK) * BLOCK + (left - column * BLOCK);
      const int width = right - left;
      spans[count++] = {block, static_cast<GByte *>(block->GetDataRef()) + at * size,
                         samples.first + (left - strip.x) * samples.pixel, width, static_cast<size_t>(width * size)};
    }
    const bool is_whole = count == end - begin;
    if (is_whole && plain && count == 1 && width_in_bytes == samples.line && spans[0].width == BLOCK) {
      std::memcpy(spans[0].to, spans[0].from, spans[0].bytes * static_cast<size_t>(strip.height));
    } else if (is_whole) {
      for (int line = 0; line < strip.height; ++line) {
        for (int i = 0; i < count; ++i) {
          BlockSpan &span = spans[i];
          if (plain) {
            std::memcpy(span.to, span.from, span.bytes);
          } else {
            GDALCopyWords(span.from, own, static_cast<int>(size), span.to, samples.type,
                          static_cast<int>(samples.pixel), span.width);
          }
          span.from += size * BLOCK;
          span.to += samples.line;
        }
      }
    }
    for (int i = 0; i < count; ++i) {
      spans[i].block->DropLock();
    }
    if (!is_whole) {
      return CE_Failure;
    }
  }
  return CE_None;
}

// Reads bands of a layer from the tree itself.
CPLErr Level::read_directly(const Layer &layer, const Window &window, int band_count, const int *bands,
                            const Samples &samples, GSpacing band_space, const Share &share) {
  const GDALDataType own = type_of(layer.info.sample);
  const GSpacing size = GDALGetDataTypeSizeBytes(own);
  const GSpacing cell = layer.info.cell_size;
  const GSpacing line = cell * window.width;
  const bool is_packed = samples.type == own && samples.pixel == size && samples.line == line;
  const bool as_it_is = band_count == 1 && layer.channels() == 1 && is_packed;
  // Read some rows at a time, so that memory does not grow with the window.
  const int rows = std::clamp(static_cast<int>((1 << 24) / std::max<GSpacing>(1, line)), 1, std::max(1, window.height));
  const auto cells = as_it_is ? nullptr : allocate(static_cast<size_t>(line) * static_cast<size_t>(rows));
  if (!as_it_is && cells == nullptr) {
    return CE_Failure;
  }
  for (int top = 0; top < window.height; top += rows) {
    const Window part = {window.x, window.y + top, window.width, std::min(rows, window.height - top)};
    GByte *const to = samples.first + top * samples.line;
    if (read(layer, level(), part, as_it_is ? to : cells.get(), nullptr) != CE_None) {
      return CE_Failure;
    }
    for (int i = 0; i < band_count && !as_it_is; ++i) {
      copy({cells.get() + (bands[i] - layer.first_band) * size, own, cell, line},
           {to + i * band_space, samples.type, samples.pixel, samples.line}, part.width, part.height);
    }
    if (report_progress(share, static_cast<double>(top + part.height) / window.height) != CE_None) {
      return CE_Failure;
    }
  }
  return CE_None;
}

// Metadata items by their domain and key.
using Tags = std::map<std::pair<std::string, std::string>, std::string>;

void Level::describe() {
  std::vector<Tags> tags(stack->layers.size());
  for (size_t i = 0; i < tags.size(); ++i) {
    const Layer &layer = stack->layers[i];
    CPLJSONDocument document;
    if (!document.LoadMemory(std::string(spinney_metadata(layer.handle.get())))) {
      continue;
    }
    const CPLJSONObject root = document.GetRoot();
    for (const CPLJSONObject &tag : root.GetObj("tags").GetChildren()) {
      tags[i][{"", tag.GetName()}] = tag.ToString();
    }
    if (const std::string time = root.GetString("time"); !time.empty()) {
      tags[i][{"", "SPINNEY_TIME"}] = time;
    }
    if (i == stack->finest) {
      describe_crs(root.GetObj("crs"));
    }
    for (int channel = 0; channel < layer.channels(); ++channel) {
      describe_band(layer, root, channel);
    }
    for (const CPLJSONObject &scoped : root.GetArray("scoped_tags")) {
      const std::string domain = scoped.GetString("domain");
      const int channel = scoped.GetInteger("channel", -1);
      for (const CPLJSONObject &tag : scoped.GetObj("tags").GetChildren()) {
        if (channel < 0) {
          tags[i][{domain, tag.GetName()}] = tag.ToString();
        } else if (channel < layer.channels()) {
          GetRasterBand(layer.first_band + channel)
              ->SetMetadataItem(tag.GetName().c_str(), tag.ToString().c_str(), domain.c_str());
        }
      }
    }
  }
  // Items that all layers share become the dataset's metadata, all others the metadata of each
  // layer's bands.
  for (size_t i = 0; i < tags.size(); ++i) {
    for (const auto &[place, value] : tags[i]) {
      const auto &[domain, key] = place;
      const bool is_common = std::all_of(tags.begin(), tags.end(), [&place = place, &value = value](const Tags &other) {
        const auto found = other.find(place);
        return found != other.end() && found->second == value;
      });
      if (is_common && i == 0) {
        SetMetadataItem(key.c_str(), value.c_str(), domain.c_str());
      }
      for (int channel = 0; channel < stack->layers[i].channels() && !is_common; ++channel) {
        GetRasterBand(stack->layers[i].first_band + channel)->SetMetadataItem(key.c_str(), value.c_str(), domain.c_str());
      }
    }
  }
  if (const uint64_t commit = stack->reference().info.commit; commit > 0) {
    SetMetadataItem("SPINNEY_COMMIT", std::to_string(commit).c_str());
  }
  SetMetadataItem("INTERLEAVE", tags.size() == 1 ? "PIXEL" : "BAND", "IMAGE_STRUCTURE");
}

// Lists all layers as subdatasets, if there are several.
void Level::list_layers(const std::string &file) {
  for (size_t i = 0; i < stack->layers.size() && stack->layers.size() > 1; ++i) {
    const Layer &layer = stack->layers[i];
    const std::string item = "SUBDATASET_" + std::to_string(i + 1);
    const std::string shape = std::to_string(layer.channels()) + "x" + std::to_string(layer.info.size[1]) + "x" +
                              std::to_string(layer.info.size[0]);
    const std::string text =
        "[" + shape + "] " + layer.name + " (" + GDALGetDataTypeName(type_of(layer.info.sample)) + ")";
    SetMetadataItem((item + "_NAME").c_str(), (file + ":" + layer.name).c_str(), "SUBDATASETS");
    SetMetadataItem((item + "_DESC").c_str(), text.c_str(), "SUBDATASETS");
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
  // Without a system GDAL would treat the raster as not georeferenced: keep the definition, and
  // warn.
  reference.Clear();
  SetMetadataItem("SPINNEY_CRS", definition.c_str());
  if (is_finest()) {
    const std::string problem = crs.GetString("problem");
    CPLError(CE_Warning, CPLE_AppDefined, "the coordinate system is only in the metadata item SPINNEY_CRS: %s",
             problem.empty() ? "unknown to PROJ" : problem.c_str());
  }
}

// Returns the name of a band: in files of several layers the layer's, with the channel's name if it
// has several.
std::string description_of(const std::string &layer, const std::string &band, int channel, int channels, bool is_alone) {
  if (channels == 1) {
    return is_alone && !band.empty() ? band : layer;
  }
  return is_alone ? band : layer + "." + (band.empty() ? std::to_string(channel + 1) : band);
}

void Level::describe_band(const Layer &layer, const CPLJSONObject &document, int channel) {
  auto *band = static_cast<Channel *>(GetRasterBand(layer.first_band + channel));
  const CPLJSONArray bands = document.GetArray("bands");
  std::string band_name;
  if (channel < bands.Size()) {
    const CPLJSONObject own = bands[channel];
    const CPLJSONObject name = own.GetObj("name");
    if (name.GetType() == CPLJSONObject::Type::String) {
      band_name = name.ToString();
    }
    const CPLJSONObject unit = own.GetObj("unit");
    if (unit.GetType() == CPLJSONObject::Type::String) {
      band->unit = unit.ToString();
    }
    band->scale = own.GetDouble("scale", 1.0);
    band->offset = own.GetDouble("offset", 0.0);
  }
  const bool is_alone = stack->layers.size() == 1;
  const std::string description =
      description_of(document.GetString("name"), band_name, channel, layer.channels(), is_alone);
  band->SetDescription(description.c_str());
  // Statistics, in GDAL's metadata items.
  const spinney_channel_statistics &known = layer.statistics.channels[channel];
  if (known.cells > 0) {
    band->SetMetadataItem("STATISTICS_MINIMUM", layer.extreme(layer.minimum, known.min).c_str());
    band->SetMetadataItem("STATISTICS_MAXIMUM", layer.extreme(layer.maximum, known.max).c_str());
    band->SetMetadataItem("STATISTICS_MEAN", CPLSPrintf("%.17g", known.mean));
    band->SetMetadataItem("STATISTICS_STDDEV", CPLSPrintf("%.17g", known.standard_deviation));
  }
  if (layer.channels() > 1) {
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
  // GDAL's names are those of 0, 1, 2 ...; a few large numbers would make a very long list.
  constexpr long MAX_NAMES = 65536;
  std::vector<std::string> names;
  for (const CPLJSONObject &category : document.GetObj("categories").GetChildren()) {
    const long value = std::strtol(category.GetName().c_str(), nullptr, 10);
    if (value >= 0 && value < MAX_NAMES) {
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

// Whether GDAL's own virtual file systems read a file: `/vsicurl/https://...`, `/vsis3/...`,
// `/vsizip/...`.
bool is_remote(const char *name) {
  return STARTS_WITH(name, "/vsi");
}

// A file that GDAL reads, one call at a time.
struct VirtualFile {
  VSILFILE *file;
  std::mutex mutex;

  explicit VirtualFile(VSILFILE *opened) : file(opened) {}
  ~VirtualFile() { VSIFCloseL(file); }
  VirtualFile(const VirtualFile &) = delete;
  VirtualFile &operator=(const VirtualFile &) = delete;

  static int32_t fetch(void *user, size_t count, const uint64_t *offsets, const size_t *lengths, uint8_t *const *buffers) {
    auto *const self = static_cast<VirtualFile *>(user);
    const std::lock_guard<std::mutex> lock(self->mutex);
    std::vector<void *> data(buffers, buffers + count);
    std::vector<vsi_l_offset> starts(offsets, offsets + count);
    std::vector<size_t> sizes(lengths, lengths + count);
    return VSIFReadMultiRangeL(static_cast<int>(count), data.data(), starts.data(), sizes.data(), self->file);
  }

  static void release(void *user) { delete static_cast<VirtualFile *>(user); }
};

bool is_tree(const void *header) {
  return std::memcmp(header, "\x93Goblin\n", 8) == 0 || std::memcmp(header, "\x93" "Autumn\n", 8) == 0;
}

// Returns the file in a layer's name: `stack.goblin:B08`, `stack.autumn@12:B08`. Empty if there is
// none.
std::string file_of_layer(const char *name) {
  // (Names that are whole documents have many colons: skip them.)
  if (std::strchr("<{[", name[0]) != nullptr || std::strlen(name) > 8192) {
    return "";
  }
  // (Names of remote files have more colons, before the last component.)
  const char *const last = is_remote(name) ? std::strrchr(name, '/') : name;
  const char *colon = std::strchr(last, ':');
  for (; colon != nullptr; colon = std::strchr(colon + 1, ':')) {
    const std::string whole(name, colon);
    std::string file = whole;
    VSIStatBufL found;
    if (VSIStatL(file.c_str(), &found) != 0 && is_commit(whole.c_str())) {
      file.resize(file.rfind('@'));
    }
    if (file.empty() || VSIStatL(file.c_str(), &found) != 0 || !VSI_ISREG(found.st_mode)) {
      continue;
    }
    char header[8] = {};
    VSILFILE *const opened = VSIFOpenL(file.c_str(), "rb");
    const bool is_there = opened != nullptr && VSIFReadL(header, 1, 8, opened) == 8 && is_tree(header);
    if (opened != nullptr) {
      VSIFCloseL(opened);
    }
    return is_there ? file : "";
  }
  return "";
}

int Level::identify(GDALOpenInfo *info) {
  if (info->nHeaderBytes < 8) {
    return is_commit(info->pszFilename) || !file_of_layer(info->pszFilename).empty();
  }
  return is_tree(info->pabyHeader);
}

// Opens the first layer of a file that GDAL reads, or the named layer; false, with GDAL's error, on
// failure.
bool open_remote(const char *name, bool is_layer, spinney_dataset **opened) {
  std::string whole = name;
  std::string layer;
  if (is_layer) {
    const size_t colon = whole.find(':', whole.rfind('/'));
    layer = whole.substr(colon + 1);
    whole.resize(colon);
  }
  std::string file = whole;
  VSIStatBufL found;
  if (VSIStatL(file.c_str(), &found) != 0 && is_commit(whole.c_str())) {
    file.resize(file.rfind('@'));
  }
  VSILFILE *const reader = VSIStatL(file.c_str(), &found) == 0 ? VSIFOpenL(file.c_str(), "rb") : nullptr;
  if (reader == nullptr) {
    CPLError(CE_Failure, CPLE_OpenFailed, "%s: cannot be read", file.c_str());
    return false;
  }
  auto *const source = new VirtualFile(reader);
  const auto length = static_cast<uint64_t>(found.st_size);
  if (spinney_open_parts(whole.c_str(), length, VirtualFile::fetch, VirtualFile::release, source, opened) != SPINNEY_OK) {
    report();
    return false;
  }
  if (layer.empty()) {
    return true;
  }
  const Handle first(*opened);
  if (spinney_open_layer(first.get(), layer.c_str(), 0, opened) != SPINNEY_OK) {
    report();
    return false;
  }
  return true;
}

// Opens the layers of a file, or the named layer; null, with GDAL's error, on failure.
std::shared_ptr<const Stack> open_stack(const char *name, bool is_layer) {
  auto stack = std::make_shared<Stack>();
  spinney_dataset *opened = nullptr;
  if (is_remote(name)) {
    if (!open_remote(name, is_layer, &opened)) {
      return nullptr;
    }
  } else if (spinney_open(name, nullptr, 0, 0, &opened) != SPINNEY_OK) {
    report();
    return nullptr;
  }
  Handle first(opened);
  size_t count = 1;
  if (!is_layer && spinney_layer_count(first.get(), &count) != SPINNEY_OK) {
    report();
    return nullptr;
  }
  if (count > MAX_LAYERS) {
    CPLError(CE_Failure, CPLE_NotSupported, "%s: has %llu layers, expected at most %d; open one of them, as in %s:%s", name,
             static_cast<unsigned long long>(count), static_cast<int>(MAX_LAYERS), name,
             spinney_layer_name(first.get(), 0));
    return nullptr;
  }
  for (size_t i = 0; i < count; ++i) {
    Layer layer;
    if (count > 1) {
      const char *const of = spinney_layer_name(first.get(), i);
      if (of == nullptr || spinney_open_layer(first.get(), of, 0, &opened) != SPINNEY_OK) {
        report();
        return nullptr;
      }
      layer.handle.reset(opened);
      layer.name = of;
    } else {
      layer.handle = std::move(first);
    }
    if (!layer.describe()) {
      report();
      return nullptr;
    }
    if (layer.info.axes != 2) {
      CPLError(CE_Failure, CPLE_NotSupported, "%s: is an octree, expected a quadtree (see `spinney export`)", name);
      return nullptr;
    }
    stack->layers.push_back(std::move(layer));
  }
  if (!stack->place()) {
    report();
    return nullptr;
  }
  const uint64_t max_size = static_cast<uint64_t>(std::numeric_limits<int>::max()) - BLOCK;
  if (stack->size[0] > max_size || stack->size[1] > max_size) {
    CPLError(CE_Failure, CPLE_NotSupported, "%s: is larger than GDAL's maximum raster size", name);
    return nullptr;
  }
  return stack;
}

GDALDataset *Level::open(GDALOpenInfo *info) {
  if (!identify(info)) {
    return nullptr;
  }
  if (info->eAccess == GA_Update) {
    CPLError(CE_Failure, CPLE_NotSupported, "Spinney files are read-only for GDAL; see `spinney edit`");
    return nullptr;
  }
  const char *const name = info->pszFilename;
  const bool is_layer = info->nHeaderBytes < 8 && !is_commit(name);
  const std::shared_ptr<const Stack> stack = open_stack(name, is_layer);
  if (stack == nullptr) {
    return nullptr;
  }
  const int depth = static_cast<int>(stack->depth());
  auto dataset = std::make_unique<Level>(stack, depth);
  dataset->SetDescription(name);
  dataset->list_layers(name);
  const bool is_small = dataset->GetRasterXSize() <= COARSEST && dataset->GetRasterYSize() <= COARSEST;
  for (int level = depth - 1; level >= 0 && !is_small; --level) {
    auto overview = std::make_unique<Level>(stack, level);
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
  driver->SetMetadataItem(GDAL_DMD_SUBDATASETS, "YES");
  driver->SetMetadataItem(GDAL_DMD_LONGNAME, "Spinney quadtrees (Goblin, Autumnal)");
  driver->SetMetadataItem(GDAL_DMD_EXTENSIONS, "goblin autumn");
  driver->pfnIdentify = Level::identify;
  driver->pfnOpen = Level::open;
  GetGDALDriverManager()->RegisterDriver(driver);
}
