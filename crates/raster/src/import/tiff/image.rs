//! Pixels of one image of the file: chunks are read, decoded and copied to their regions.

use std::ops::Range;
use std::sync::{Arc, Mutex};

use rayon::prelude::*;

use super::cache::{ChunkCache, ChunkKey};
use super::ifd::{Directory, Input};
use super::layout::{ChunkLayout, ChunkLocation};
use crate::index::RecordedChunks;
use spinney_base::space::Region;
use spinney_base::{Error, Result};
use spinney_chunks::spec::{compression, photometric, planar_configuration, predictor, sample_format, tag};
use spinney_chunks::{
    ChunkFormat, ChunkSelection, Colour, Compression, DecoderStates, Predictor, SampleFormat, Yuv, set_len,
};

/// Bytes of chunks of a remote file that are fetched together: a fraction of the capacity of the
/// cache of remote reads.
const FETCHED: u64 = 8 << 20;

/// One image of the file.
pub(super) struct Image {
    pub(super) layout: ChunkLayout,
    /// How chunks are decoded.
    pub(super) format: ChunkFormat,
    pub(super) photometric: u64,
    /// The sample of chunks that were never written.
    pub(super) hole: Vec<u8>,
    cache: Mutex<ChunkCache>,
    workers: Mutex<Vec<Worker>>,
    /// Maximum number of chunks decoded at once.
    parallel: usize,
    /// Record of the chunks for an index.
    pub(super) recorded: Option<Arc<RecordedChunks>>,
    /// Number of chunks decoded.
    #[cfg(test)]
    pub(super) decoded: std::sync::atomic::AtomicU64,
}

/// Decoder states and buffers of one thread.
#[derive(Default)]
struct Worker {
    states: DecoderStates,
    raw: Vec<u8>,
    chunk: Vec<u8>,
}

/// Section of a request that one chunk covers, with the output rows.
struct Job<'a> {
    /// The requested channels.
    chosen: &'a [usize],
    across: u64,
    down: u64,
    /// The requested pixels.
    part: Region,
    /// Whether the request covers the whole chunk.
    whole: bool,
    rows: Vec<&'a mut [u8]>,
}

impl Image {
    /// Interprets the tags of an image.
    pub(super) fn new(input: &Input, directory: &Directory<'_>) -> Result<Image> {
        let first = |tag, default| Ok::<u64, Error>(directory.number(tag)?.unwrap_or(default));
        let same = |tag, default| match directory.numbers(tag)?.unwrap_or_default().as_slice() {
            [] => Ok(default),
            [value, rest @ ..] if rest.iter().all(|other| other == value) => Ok(*value),
            values => {
                let some = &values[..values.len().min(8)];
                Err(input.odd_samples(format!("a mix of samples (tag {tag}: {some:?})")))
            }
        };
        let refuse = |what| input.unsupported(what);
        let samples = match first(tag::SAMPLES_PER_PIXEL, 1)? {
            samples @ 1..=0xffff => samples as usize,
            samples => {
                let tag = tag::SAMPLES_PER_PIXEL;
                return Err(input.corrupt(format!("tag {tag}"), format!("{samples} samples"), "1 to 65535"));
            }
        };
        let format = same(tag::SAMPLE_FORMAT, sample_format::UNSIGNED)?;
        let mut sample_format =
            SampleFormat::new(format, same(tag::BITS_PER_SAMPLE, 1)?).map_err(|what| match format {
                sample_format::COMPLEX_SIGNED | sample_format::COMPLEX_FLOAT => input.complex_samples(what),
                _ => input.odd_samples(what),
            })?;
        let codec =
            Compression::new(first(tag::COMPRESSION, compression::NONE)?, directory.bytes(tag::JPEG_TABLES)?)
                .map_err(refuse)?;
        let photometric = first(tag::PHOTOMETRIC_INTERPRETATION, photometric::BLACK_IS_ZERO)?;
        let arrangement = first(tag::PLANAR_CONFIGURATION, planar_configuration::CHUNKY)?;
        let planar = samples > 1 && arrangement == planar_configuration::PLANAR;
        let predictor = if codec.has_predictor() {
            Predictor::new(first(tag::PREDICTOR, predictor::NONE)?).map_err(refuse)?
        } else {
            Predictor::None
        };
        let colour = colour(input, directory, &codec, photometric, sample_format, samples, planar)?;
        if colour != Colour::Keep {
            // Colours have no sign.
            sample_format = SampleFormat::Uint(8);
        }
        let (planes, together) = if planar { (samples, 1) } else { (1, samples) };
        let row_bits = |pixels: u64| pixels * (sample_format.bits() * together) as u64;
        let raw = codec == Compression::None && !matches!(colour, Colour::Blocks(..));
        let layout = ChunkLayout::read(input, directory, planes as u64, raw, row_bits)?;
        let format = ChunkFormat {
            chunk_width: layout.chunk_width,
            chunk_height: layout.chunk_height,
            samples,
            planes,
            sample_format,
            predictor,
            colour,
            big_endian: input.big_endian,
            lowest_first: first(tag::FILL_ORDER, 1)? == 2 && !codec.ignores_fill_order(),
            compression: codec,
        };
        format.check().map_err(refuse)?;
        let chunk = format.chunk_bytes();
        if chunk > input.memory {
            let what = if layout.tiled { "a decoded tile" } else { "a decoded strip" };
            return Err(input.too_large(what, chunk));
        }
        let threads = rayon::current_num_threads() as u64;
        Ok(Image {
            cache: Mutex::new(ChunkCache::new(input.memory / 4)),
            workers: Mutex::default(),
            parallel: (input.memory / 2 / chunk.max(1)).clamp(1, threads) as usize,
            recorded: None,
            #[cfg(test)]
            decoded: Default::default(),
            hole: vec![0; sample_format.sample().size()],
            layout,
            format,
            photometric,
        })
    }

    /// Number of bytes to read of a compressed chunk if the file has no byte count for it: all that
    /// it may have.
    pub(super) fn assumed_length(&self, input: &Input, offset: u64) -> u64 {
        input.len.saturating_sub(offset).min(self.format.max_stored_bytes())
    }

    /// Reads some channels of a region within the image into `out`, which must have exactly their
    /// size.
    pub(super) fn read(&self, input: &Input, region: Region, chosen: &[usize], out: &mut [u8]) -> Result<()> {
        let mut jobs = self.jobs(region, chosen, out);
        while input.is_remote() && !jobs.is_empty() {
            let fetched = self.fetch(input, &mut jobs)?;
            self.run_all(input, fetched)?;
        }
        self.run_all(input, jobs)
    }

    /// Appends the byte ranges of the chunks of a region, without those that would exceed what is
    /// fetched together.
    pub(super) fn ranges(&self, region: Region, chosen: &[usize], ranges: &mut Vec<Range<u64>>) {
        let ChunkLayout { chunk_width, chunk_height, .. } = self.layout;
        let mut bytes: u64 = ranges.iter().map(|range| range.end - range.start).sum();
        let planes = if self.layout.planes > 1 { chosen } else { &[0][..] };
        for down in region.y / chunk_height..region.bottom().div_ceil(chunk_height) {
            for across in region.x / chunk_width..region.right().div_ceil(chunk_width) {
                for plane in planes {
                    let found = self.layout.location(*plane as u64, across, down);
                    if let ChunkLocation::At(offset, Some(count)) = found
                        && let Some(end) = offset.checked_add(count)
                        && bytes.saturating_add(count) <= FETCHED
                    {
                        ranges.push(offset..end);
                        bytes += count;
                    }
                }
            }
        }
    }

    /// Splits off some of the jobs, at least one, and fetches their chunks.
    fn fetch<'a>(&self, input: &Input, jobs: &mut Vec<Job<'a>>) -> Result<Vec<Job<'a>>> {
        let (mut ranges, mut bytes, mut first) = (Vec::new(), 0u64, jobs.len());
        while first > 0 && (ranges.is_empty() || bytes < FETCHED) {
            first -= 1;
            let Job { chosen, across, down, .. } = &jobs[first];
            let rows = self.layout.region(*across, *down).height;
            let planes = if self.layout.planes > 1 { chosen } else { &[0][..] };
            for plane in planes {
                let found = self.layout.location(*plane as u64, *across, *down);
                // A chunk that extends to the end of the file is not prefetched.
                if let ChunkLocation::At(offset, Some(count)) = found
                    && let Some(end) = offset.checked_add(count)
                    && !self.cache.lock().expect("no panic while held").has((offset, Some(count), rows))
                {
                    ranges.push(offset..end);
                    bytes = bytes.saturating_add(count);
                }
            }
        }
        input.prefetch(&ranges)?;
        Ok(jobs.split_off(first))
    }

    /// Fills the rows of jobs.
    fn run_all(&self, input: &Input, mut jobs: Vec<Job<'_>>) -> Result<()> {
        if jobs.len() == 1 || self.parallel == 1 {
            return jobs.into_iter().try_for_each(|job| self.run(input, job));
        }
        if self.parallel == rayon::current_num_threads() {
            return jobs.into_par_iter().try_for_each(|job| self.run(input, job));
        }
        // Each running job holds a decoded chunk, so memory limits their number.
        while !jobs.is_empty() {
            let few = jobs.split_off(jobs.len().saturating_sub(self.parallel));
            few.into_par_iter().try_for_each(|job| self.run(input, job))?;
        }
        Ok(())
    }

    /// The chunks that intersect a region, each with the rows of `out` that it fills.
    fn jobs<'a>(&self, region: Region, chosen: &'a [usize], out: &'a mut [u8]) -> Vec<Job<'a>> {
        let ChunkLayout { chunk_width, chunk_height, .. } = self.layout;
        let pixel = self.format.sample_format.sample().size() * chosen.len();
        let columns = region.x / chunk_width..region.right().div_ceil(chunk_width);
        let mut rows = out.chunks_exact_mut(region.width as usize * pixel);
        let mut jobs = Vec::new();
        for down in region.y / chunk_height..region.bottom().div_ceil(chunk_height) {
            let first = jobs.len();
            jobs.extend(columns.clone().map(|across| {
                let chunk = self.layout.region(across, down);
                let part = chunk.intersect(&region);
                let rows = Vec::with_capacity(part.height as usize);
                Job { chosen, across, down, part, whole: part == chunk, rows }
            }));
            for mut rest in rows.by_ref().take(jobs[first].part.height as usize) {
                for job in &mut jobs[first..] {
                    let (row, right) = rest.split_at_mut(job.part.width as usize * pixel);
                    job.rows.push(row);
                    rest = right;
                }
            }
        }
        jobs
    }

    /// Fills the rows of one job.
    fn run(&self, input: &Input, mut job: Job<'_>) -> Result<()> {
        let mut worker = self.workers.lock().expect("no panic while held").pop().unwrap_or_default();
        let result = if self.layout.planes > 1 {
            let mut planes = job.chosen.iter().enumerate();
            planes.try_for_each(|(place, plane)| self.fill(input, &mut worker, &mut job, *plane, place))
        } else {
            self.fill(input, &mut worker, &mut job, 0, 0)
        };
        self.workers.lock().expect("no panic while held").push(worker);
        result
    }

    /// Fills the rows of one job from a chunk: of one plane, whose channel is `place` among the
    /// chosen ones, or of all channels.
    fn fill(
        &self,
        input: &Input,
        worker: &mut Worker,
        job: &mut Job<'_>,
        plane: usize,
        place: usize,
    ) -> Result<()> {
        let ChunkLocation::At(offset, count) = self.layout.location(plane as u64, job.across, job.down)
        else {
            let size = self.hole.len();
            let of_plane = self.layout.planes > 1;
            let (skip, step) = if of_plane { (place, job.chosen.len()) } else { (0, 1) };
            let samples =
                job.rows.iter_mut().flat_map(|row| row.chunks_exact_mut(size).skip(skip).step_by(step));
            samples.for_each(|sample| sample.copy_from_slice(&self.hole));
            return Ok(());
        };
        let key = (offset, count, self.layout.region(job.across, job.down).height);
        let cached = self.cache.lock().expect("no panic while held").get(key);
        if let Some(chunk) = cached {
            self.copy(&chunk, &mut worker.states, job, place);
            return Ok(());
        }
        self.decode(input, worker, job, plane as u64, key)?;
        self.copy(&worker.chunk, &mut worker.states, job, place);
        // Partially read or repeated chunks are likely to be needed again.
        if !job.whole || self.layout.repeats {
            let chunk = Arc::new(std::mem::take(&mut worker.chunk));
            worker.chunk = self.cache.lock().expect("no panic while held").put(key, chunk);
        }
        Ok(())
    }

    /// Decodes a chunk into `worker.chunk`.
    fn decode(
        &self,
        input: &Input,
        worker: &mut Worker,
        job: &Job<'_>,
        plane: u64,
        (offset, count, rows): ChunkKey,
    ) -> Result<()> {
        #[cfg(test)]
        self.decoded.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let place = || self.layout.name(plane, job.across, job.down);
        // Tiles at the bottom should include rows outside of the image, but some writers omit
        // these.
        let rows = rows as usize;
        let Worker { states, raw, chunk } = worker;
        let record = |bytes: &[u8]| {
            if let Some(recorded) = &self.recorded {
                recorded.record(self.layout.number(plane, job.across, job.down), bytes);
            }
        };
        if self.format.compression == Compression::None {
            set_len(chunk, self.format.decoded_bytes(rows).0);
            if let Some(count) = count.filter(|count| *count < chunk.len() as u64) {
                let found = format!("{count} bytes");
                return Err(input.corrupt(place(), found, format!("{} bytes of samples", chunk.len())));
            }
            input.read_at(offset, chunk, place)?;
            record(chunk);
            self.format.restore(chunk, rows);
            return Ok(());
        }
        let count = count.unwrap_or_else(|| self.assumed_length(input, offset));
        input.check(offset, count, place)?;
        if count > input.memory {
            return Err(input.too_large(place(), count));
        }
        set_len(raw, count as usize);
        input.read_at(offset, raw, place)?;
        record(raw);
        self.format.decode(states, raw, rows, chunk).map_err(|found| {
            let expected = format!("{} bytes of samples", self.format.decoded_bytes(rows).0);
            input.corrupt(place(), found, expected)
        })
    }

    /// Widens the requested samples of a decoded chunk into the rows of a job.
    fn copy(&self, chunk: &[u8], states: &mut DecoderStates, job: &mut Job<'_>, slot: usize) {
        let selection = ChunkSelection {
            left: (job.part.x - job.across * self.layout.chunk_width) as usize,
            top: (job.part.y - job.down * self.layout.chunk_height) as usize,
            width: job.part.width as usize,
            chosen: job.chosen,
            slot,
        };
        self.format.copy(states, chunk, &selection, &mut job.rows);
    }
}

/// Decides on the conversion of samples to RGB.
fn colour(
    input: &Input,
    directory: &Directory<'_>,
    codec: &Compression,
    photometric: u64,
    sample_format: SampleFormat,
    samples: usize,
    planar: bool,
) -> Result<Colour> {
    let bytes = matches!(sample_format, SampleFormat::Uint(8) | SampleFormat::Int(8));
    let refuse = |what: &str| Err(input.unsupported(what));
    match photometric {
        photometric::YCBCR if samples == 3 && bytes && !planar => {
            if matches!(codec, Compression::Jpeg(_)) {
                return Ok(Colour::Jpeg);
            }
            let (h, v) = match directory.numbers(tag::YCBCR_SUB_SAMPLING)?.as_deref() {
                None => (2, 2),
                Some(&[h @ (1 | 2 | 4), v @ (1 | 2 | 4), ..]) => (h as usize, v as usize),
                Some(other) => {
                    let tag = tag::YCBCR_SUB_SAMPLING;
                    return Err(input.corrupt(
                        format!("tag {tag}"),
                        format!("{other:?}"),
                        "two numbers, each 1, 2 or 4",
                    ));
                }
            };
            let range = directory.doubles(tag::REFERENCE_BLACK_WHITE)?;
            if !range.is_empty() && range != [0.0, 255.0, 128.0, 255.0, 128.0, 255.0] {
                return refuse("colour that does not use the full range (tag 532)");
            }
            let shares: Vec<f32> =
                directory.doubles(tag::YCBCR_COEFFICIENTS)?.into_iter().map(|share| share as f32).collect();
            let shares = match shares[..] {
                [red, green, blue] if green != 0.0 => [red, green, blue],
                _ => [0.299, 0.587, 0.114],
            };
            Ok(Colour::Blocks(Yuv::new(shares), h, v))
        }
        photometric::YCBCR => refuse("YCbCr other than 3 samples of 8 bits"),
        photometric::SEPARATED if samples >= 4 && bytes => Ok(Colour::Cmyk),
        photometric::CIELAB..=photometric::ITULAB => refuse("CIE L*a*b* colour"),
        _ => Ok(Colour::Keep),
    }
}
