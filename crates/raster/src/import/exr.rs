//! Reader of OpenEXR, block by block.

use std::collections::{BTreeMap, VecDeque};
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use exr::block::UncompressedBlock;
use exr::block::chunk::Chunk;
use exr::meta::attribute::{LevelMode, SampleType as ExrType};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use half::f16;

use super::{Order, Pixels, Raster, RasterInfo, RasterOptions};
use spinney_base::guard::guard;
use spinney_base::io::InputFile;
use spinney_base::space::Region;
use spinney_base::value::SampleType;
use spinney_base::{Error, Result};

/// Channels that belong together: of one part of the file, with one prefix.
struct Layer {
    name: String,
    header: usize,
    /// Name after the prefix, and index in the part's channel list.
    channels: Vec<(String, usize)>,
}

struct Exr {
    path: PathBuf,
    info: RasterInfo,
    file: BufReader<InputFile>,
    meta: MetaData,
    /// Index of the part that is read.
    header: usize,
    /// Per channel that is read: its index in the part's channel list, and its type.
    channels: Vec<(usize, ExrType)>,
    /// File offset of the part's block offset table.
    table: u64,
    /// Width and height of a block.
    block: [u64; 2],
    /// Decoded blocks, the most recently used last.
    cache: VecDeque<(u64, Vec<u8>)>,
    cache_bytes: u64,
    cache_limit: u64,
}

pub(super) fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let mut file = BufReader::new(options.access.input(path)?);
    let meta = guard(path, "EXR header", || {
        let fail = |error| exr_error(path, "EXR header", error);
        let meta = MetaData::read_from_buffered(&mut file, false).map_err(fail)?;
        MetaData::validate(&meta.headers, false).map_err(fail)?;
        Ok(meta)
    })?;
    let tables = file.stream_position().map_err(Error::io(path, "read"))?;

    let (layer, remark) = choose_layer(path, &meta.headers, options.layer.as_deref())?;
    let header = &meta.headers[layer.header];
    check_supported(path, header)?;
    let (sample, channels) = choose_channels(path, header, &layer)?;
    let block = block_size(path, header, options)?;

    let [width, height] = [header.layer_size.0 as u64, header.layer_size.1 as u64];
    let names: Vec<String> = channels.iter().map(|&(index, _)| layer.channels[index].0.clone()).collect();
    let channels: Vec<(usize, ExrType)> =
        channels.iter().map(|&(_, number)| (number, header.channels.list[number].sample_type)).collect();
    let info = RasterInfo {
        stored_sample: match sample {
            SampleType::U32 => "uint32",
            _ if channels.iter().all(|&(_, sample)| sample == ExrType::F16) => "half",
            _ => "float",
        }
        .into(),
        alpha: names.iter().position(|name| name == "A").filter(|_| names.len() == 2 || names.len() == 4),
        layout: layout(header),
        tags: tags(header, &layer.name),
        remark,
        order: if header.blocks.has_tiles() { Order::Anywhere } else { Order::Bands },
        ..RasterInfo::plain([width, height], sample, channels.len())
    };
    let earlier_blocks: u64 = meta.headers[..layer.header].iter().map(|h| h.chunk_count as u64).sum();
    Ok(Box::new(Exr {
        path: path.to_path_buf(),
        info: RasterInfo { band_names: names, ..info },
        channels,
        file,
        header: layer.header,
        table: tables + 8 * earlier_blocks,
        block,
        cache: VecDeque::new(),
        cache_bytes: 0,
        cache_limit: options.memory / 2,
        meta,
    }))
}

/// All layers; in each part those without a prefix come first.
fn layers(headers: &[Header]) -> Vec<Layer> {
    let mut layers: Vec<Layer> = Vec::new();
    for (number, header) in headers.iter().enumerate() {
        let part = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
        let start = layers.len();
        for (index, channel) in header.channels.list.iter().enumerate() {
            let full = channel.name.to_string();
            let (prefix, channel) = full.rsplit_once('.').unwrap_or(("", &full));
            let name = match (part.as_str(), prefix) {
                (part, "") => part.to_string(),
                (part, prefix) if headers.len() > 1 => format!("{part}.{prefix}"),
                (_, prefix) => prefix.to_string(),
            };
            let channel = (channel.to_string(), index);
            match layers[start..].iter_mut().find(|layer| layer.name == name) {
                Some(layer) => layer.channels.push(channel),
                None => {
                    let layer = Layer { name, header: number, channels: vec![channel] };
                    layers.insert(if prefix.is_empty() { start } else { layers.len() }, layer);
                }
            }
        }
    }
    layers
}

/// Returns the requested layer, or by default the first one, with a remark on the others.
fn choose_layer(path: &Path, headers: &[Header], wanted: Option<&str>) -> Result<(Layer, Option<String>)> {
    let mut layers = layers(headers);
    let names = layers.iter().map(|layer| format!("`{}`", layer.name)).collect::<Vec<_>>().join(", ");
    let found = match wanted {
        None => 0,
        Some(wanted) => layers
            .iter()
            .position(|layer| layer.name == wanted)
            .ok_or_else(|| Error::invalid("layer", format!("`{wanted}`"), format!("one of {names}")))?,
    };
    let remark = (wanted.is_none() && layers.len() > 1).then(|| {
        format!(
            "has {} layers, {names}; the first is read, --layer NAME (in Python layer=) selects another",
            layers.len()
        )
    });
    if layers.is_empty() {
        return Err(Error::corrupt(path, "EXR header", "no channels", "at least one channel"));
    }
    Ok((layers.swap_remove(found), remark))
}

fn check_supported(path: &Path, header: &Header) -> Result<()> {
    use exr::meta::attribute::Compression;
    let refuse = |found: &str| {
        Err(Error::unsupported(path, found, "convert it to ZIP compression with another program"))
    };
    if header.deep {
        return refuse("deep data");
    }
    if header.channels.list.iter().any(|channel| channel.sampling.0 != 1 || channel.sampling.1 != 1) {
        return refuse("an EXR with subsampled channels (luminance and chroma)");
    }
    if matches!(header.compression, Compression::HTJ2K32 | Compression::HTJ2K256) {
        return refuse("HTJ2K compression");
    }
    if header.layer_size.0 == 0 || header.layer_size.1 == 0 {
        return Err(Error::corrupt(path, "EXR data window", "no pixels", "at least one pixel"));
    }
    Ok(())
}

/// Selects the channels to read: RGB if available, otherwise luminance, otherwise all in
/// alphabetical order. Each is returned as its index in the layer and in the part.
fn choose_channels(path: &Path, header: &Header, layer: &Layer) -> Result<(SampleType, Vec<(usize, usize)>)> {
    let index_of = |wanted: &str| layer.channels.iter().position(|(name, _)| name == wanted);
    let colours = ["R", "G", "B"].map(index_of);
    let chosen: Vec<usize> = match (colours, index_of("Y")) {
        ([Some(r), Some(g), Some(b)], _) => [r, g, b].into_iter().chain(index_of("A")).collect(),
        (_, Some(y)) => [y].into_iter().chain(index_of("A")).collect(),
        _ => (0..layer.channels.len()).collect(),
    };
    let chosen: Vec<(usize, usize)> = chosen.into_iter().map(|i| (i, layer.channels[i].1)).collect();
    let is_uint = |&(_, number): &(usize, usize)| header.channels.list[number].sample_type == ExrType::U32;
    let sample = match chosen.iter().filter(|channel| is_uint(channel)).count() {
        0 => SampleType::F32,
        uints if uints == chosen.len() => SampleType::U32,
        _ => {
            let found = "an EXR layer with both uint and floating channels";
            return Err(Error::unsupported(path, found, "store them in separate layers"));
        }
    };
    Ok((sample, chosen))
}

/// Width and height of a block, checked against the memory.
fn block_size(path: &Path, header: &Header, options: &RasterOptions) -> Result<[u64; 2]> {
    let exr::math::Vec2(width, height) = header.max_block_pixel_size();
    let (width, height) = (width as u64, height as u64);
    if width == 0 || height == 0 {
        return Err(Error::corrupt(
            path,
            "EXR tile description",
            "tiles without pixels",
            "at least one pixel",
        ));
    }
    let bytes = width.saturating_mul(height).saturating_mul(header.channels.bytes_per_pixel as u64);
    // Compressed, decompressed, and a row of tiles to copy from.
    options.check_memory(path, "decoding a block", bytes.saturating_mul(3))?;
    Ok([width, height])
}

fn layout(header: &Header) -> String {
    let blocks = match header.blocks {
        BlockDescription::ScanLines => "rows".to_string(),
        BlockDescription::Tiles(tiles) => {
            let levels = if tiles.level_mode == LevelMode::Singular { "" } else { " with levels" };
            format!("{}x{} tiles{levels}", tiles.tile_size.0, tiles.tile_size.1)
        }
    };
    format!("OpenEXR, {blocks}, {}", header.compression)
}

fn tags(header: &Header, layer: &str) -> BTreeMap<String, String> {
    let window = |position: exr::math::Vec2<i32>, size: exr::math::Vec2<usize>| {
        format!("{} x {} at ({}, {})", size.0, size.1, position.0, position.1)
    };
    let display = header.shared_attributes.display_window;
    let own = &header.own_attributes;
    let mut tags = BTreeMap::new();
    tags.extend([
        ("data window".to_string(), window(own.layer_position, header.layer_size)),
        ("display window".to_string(), window(display.position, display.size)),
    ]);
    let strings = [
        ("layer", Some(layer.to_string()).filter(|name| !name.is_empty())),
        ("owner", own.owner.as_ref().map(ToString::to_string)),
        ("comments", own.comments.as_ref().map(ToString::to_string)),
        ("capture date", own.capture_date.as_ref().map(ToString::to_string)),
    ];
    tags.extend(strings.into_iter().filter_map(|(name, text)| Some((name.to_string(), text?))));
    tags
}

impl Exr {
    /// Moves a block to the end of the cache; decodes it if necessary.
    fn load(&mut self, index: u64) -> Result<()> {
        if let Some(at) = self.cache.iter().position(|&(number, _)| number == index) {
            let block = self.cache.remove(at);
            self.cache.extend(block);
            return Ok(());
        }
        let block = self.decode(index)?;
        self.cache_bytes += block.len() as u64;
        while self.cache_bytes > self.cache_limit {
            let Some((_, oldest)) = self.cache.pop_front() else { break };
            self.cache_bytes -= oldest.len() as u64;
        }
        self.cache.push_back((index, block));
        Ok(())
    }

    /// Decodes a block of the full resolution. The blocks of this resolution come first in the
    /// table, row by row.
    fn decode(&mut self, index: u64) -> Result<Vec<u8>> {
        let place = format!("EXR block {index}");
        let wrong = |found: String, expected| Error::corrupt(&self.path, &place, found, expected);
        let mut offset = [0; 8];
        let read = self.file.seek(SeekFrom::Start(self.table + 8 * index));
        read.and_then(|_| self.file.read_exact(&mut offset))
            .map_err(|error| exr_error(&self.path, "EXR offset table", error.into()))?;
        let offset = u64::from_le_bytes(offset);
        if offset < self.table {
            return Err(wrong(
                format!("offset {offset}"),
                "a block after the offset table (the file may be incomplete)",
            ));
        }
        self.file
            .seek(SeekFrom::Start(offset))
            .map_err(|error| exr_error(&self.path, &place, error.into()))?;

        let columns = self.info.width.div_ceil(self.block[0]);
        let corner = [index % columns * self.block[0], index / columns * self.block[1]];
        let block = guard(&self.path, &place, || {
            let fail = |error| exr_error(&self.path, &place, error);
            let chunk = Chunk::read(&mut self.file, &self.meta).map_err(fail)?;
            if chunk.layer_index != self.header {
                return Err(wrong(
                    format!("a block of part {}", chunk.layer_index),
                    "a block of the same part",
                ));
            }
            UncompressedBlock::decompress_chunk(chunk, &self.meta, false).map_err(fail)
        })?;
        let at = block.index.pixel_position;
        let is_full = block.index.level.0 == 0 && block.index.level.1 == 0;
        if [at.0 as u64, at.1 as u64] != corner || !is_full {
            return Err(wrong(
                format!("the block at ({}, {})", at.0, at.1),
                "the block that the offset table lists",
            ));
        }
        let expected = self.block_columns(corner[0]) * self.block_rows(corner[1]) * self.pixel_bytes();
        if block.data.len() as u64 != expected {
            return Err(wrong(format!("{} bytes", block.data.len()), "the bytes of its pixels"));
        }
        Ok(block.data)
    }

    /// Columns of the block that starts at column `x`; fewer at the right edge.
    fn block_columns(&self, x: u64) -> u64 {
        self.block[0].min(self.info.width - x)
    }

    fn block_rows(&self, y: u64) -> u64 {
        self.block[1].min(self.info.height - y)
    }

    /// Bytes of a pixel with all channels of the part.
    fn pixel_bytes(&self) -> u64 {
        self.meta.headers[self.header].channels.bytes_per_pixel as u64
    }

    /// Copies the intersection of a decoded block and `region` to `out`, which has the region's
    /// pixels.
    fn copy(&self, block: &[u8], corner: [u64; 2], region: Region, out: &mut [u8]) {
        let columns = self.block_columns(corner[0]);
        let area = Region::new(corner[0], corner[1], columns, self.block_rows(corner[1]));
        let part = area.intersect(&region);
        let list = &self.meta.headers[self.header].channels.list;
        let pixel = 4 * self.channels.len();
        for y in part.y..part.bottom() {
            let line = &block[((y - area.y) * columns * self.pixel_bytes()) as usize..];
            let out_row = &mut out[((y - region.y) * region.width + part.x - region.x) as usize * pixel..];
            for (index, &(number, sample)) in self.channels.iter().enumerate() {
                // In a line of a block, the samples of each channel are contiguous.
                let before: usize = list[..number].iter().map(|c| c.sample_type.bytes_per_sample()).sum();
                let size = sample.bytes_per_sample();
                let start = before * columns as usize + (part.x - area.x) as usize * size;
                let samples = &line[start..][..part.width as usize * size];
                let targets = out_row.chunks_exact_mut(pixel).map(|p| &mut p[4 * index..4 * index + 4]);
                copy_samples(samples, sample, targets);
            }
        }
    }
}

/// Copies samples, which the decoder returns in native byte order, as little-endian f32 or u32.
#[allow(clippy::host_endian_bytes)] // the decoder's interface is in native byte order
fn copy_samples<'a>(samples: &[u8], sample: ExrType, targets: impl Iterator<Item = &'a mut [u8]>) {
    if sample == ExrType::F16 {
        for (target, &bytes) in targets.zip(samples.as_chunks::<2>().0) {
            target.copy_from_slice(&f16::from_ne_bytes(bytes).to_f32().to_le_bytes());
        }
    } else {
        for (target, &bytes) in targets.zip(samples.as_chunks::<4>().0) {
            target.copy_from_slice(&u32::from_ne_bytes(bytes).to_le_bytes());
        }
    }
}

impl Raster for Exr {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn reads_anywhere(&self) -> bool {
        true
    }

    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()> {
        self.info.check(region)?;
        pixels.valid = None;
        pixels.bytes.clear();
        pixels.bytes.resize(region.area() as usize * self.info.pixel_bytes(), 0);
        if region.is_empty() {
            return Ok(());
        }
        let [width, height] = self.block;
        let columns = self.info.width.div_ceil(width);
        for row in region.y / height..region.bottom().div_ceil(height) {
            for column in region.x / width..region.right().div_ceil(width) {
                self.load(row * columns + column)?;
                let block = self.cache.back().map_or(&[][..], |(_, block)| block);
                self.copy(block, [column * width, row * height], region, &mut pixels.bytes);
            }
        }
        Ok(())
    }
}

fn exr_error(path: &Path, place: &str, error: exr::error::Error) -> Error {
    match error {
        exr::error::Error::NotSupported(found) => {
            let advice = "convert it with another program";
            Error::unsupported(path, format!("this OpenEXR file ({found})"), advice)
        }
        exr::error::Error::Io(error) => Error::io(path, "read")(error),
        exr::error::Error::Invalid(found) => Error::corrupt(path, place, found, "a valid OpenEXR file"),
        exr::error::Error::Aborted => Error::Interrupted,
    }
}

#[cfg(test)]
mod tests {
    use exr::meta::attribute::{ChannelDescription, Text};

    use super::*;

    fn part(name: &str, channels: &[(&str, ExrType)]) -> Header {
        let describe = |&(name, sample)| ChannelDescription::named(name, sample);
        Header::new(Text::from(name), (4, 4), channels.iter().map(describe).collect())
    }

    fn names(headers: &[Header]) -> Vec<String> {
        layers(headers).into_iter().map(|layer| layer.name).collect()
    }

    #[test]
    fn layers_are_parts_and_prefixes() {
        let single = part("", &["B", "G", "R", "aov.x.R", "aov.y.Z"].map(|name| (name, ExrType::F32)));
        assert_eq!(names(&[single]), ["", "aov.x", "aov.y"]);
        let unprefixed_is_first = part("", &["Aov.R", "R"].map(|name| (name, ExrType::F32)));
        assert_eq!(names(&[unprefixed_is_first]), ["", "Aov"]);
        let (left, right) = (part("left", &[("R", ExrType::F16)]), part("right", &[("d.Z", ExrType::F32)]));
        let parts = [left, right];
        assert_eq!(names(&parts), ["left", "right.d"]);
        let (chosen, remark) = choose_layer(Path::new("a.exr"), &parts, Some("right.d")).unwrap();
        assert_eq!((chosen.header, remark), (1, None));
        let (first, remark) = choose_layer(Path::new("a.exr"), &parts, None).unwrap();
        assert!(
            first.header == 0 && remark.unwrap().contains("2 layers, `left`, `right.d`; the first is read")
        );
        let unknown = choose_layer(Path::new("a.exr"), &parts, Some("middle")).map(|(layer, _)| layer.name);
        assert!(unknown.unwrap_err().to_string().contains("one of `left`, `right.d`"));
    }

    #[test]
    fn channels_are_colours_or_luminance_or_all() {
        let choose = |channels: &[(&str, ExrType)]| -> Result<(SampleType, String)> {
            let header = part("", channels);
            let layer = layers(std::slice::from_ref(&header)).swap_remove(0);
            let (sample, chosen) = choose_channels(Path::new("a.exr"), &header, &layer)?;
            Ok((sample, chosen.iter().map(|&(index, _)| layer.channels[index].0.as_str()).collect()))
        };
        let float =
            |names: &[&'static str]| names.iter().map(|&name| (name, ExrType::F32)).collect::<Vec<_>>();
        let chosen = |channels: &[(&str, ExrType)]| choose(channels).unwrap();
        assert_eq!(chosen(&float(&["A", "B", "G", "R", "Z"])), (SampleType::F32, "RGBA".into()));
        assert_eq!(chosen(&float(&["A", "Y"])), (SampleType::F32, "YA".into()));
        assert_eq!(chosen(&float(&["G", "Z"])), (SampleType::F32, "GZ".into()));
        assert_eq!(chosen(&[("id", ExrType::U32)]), (SampleType::U32, "id".into()));
        assert_eq!(chosen(&[("Y", ExrType::F16), ("id", ExrType::U32)]), (SampleType::F32, "Y".into()));
        let mixed = choose(&[("X", ExrType::F16), ("id", ExrType::U32)]);
        assert!(matches!(mixed, Err(Error::Unsupported { .. })));
    }
}
